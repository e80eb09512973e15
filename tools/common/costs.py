"""Costs of a net: seconds per layer and pass, bytes per blob."""

from __future__ import annotations

import time
from collections import defaultdict

import numpy as np

from netlib.engine.plain import Connection
from netlib.net import Net


def time_layers(net: Net, iterations: int) -> tuple[dict[str, float], dict[str, float]]:
    """Mean seconds of each layer forwards and backwards, on one thread."""
    forward: dict[str, float] = defaultdict(float)
    backward: dict[str, float] = defaultdict(float)
    threads = net.engine.threads()
    net.engine.set_threads(1)
    for _ in range(iterations):
        for step in net.executor.steps:
            for piece in step.pieces():
                for at in piece:
                    begin = time.perf_counter()
                    at.layer.forward(at.bottom, at.top)
                    forward[at.layer.name] += (time.perf_counter() - begin) / iterations
                if len(piece) > 1:  # the memory of a shard is reused by the next one: run it backwards now
                    _time_backward(net, piece, backward, iterations)
        for step in reversed(net.executor.steps):
            for piece in step.pieces():
                if len(piece) == 1:
                    _time_backward(net, piece, backward, iterations)
    net.engine.set_threads(threads)
    return forward, backward


def _time_backward(net: Net, piece: list[Connection], backward: dict[str, float], iterations: int) -> None:
    for at in reversed(piece):
        if at.needs_backward:
            for param in at.layer.blobs:
                param.diff.fill(0)
            begin = time.perf_counter()
            at.layer.backward(at.top, at.propagate_down, at.bottom)
            backward[at.layer.name] += (time.perf_counter() - begin) / iterations


def time_passes(net: Net, iterations: int) -> tuple[float, float]:
    """Median seconds of a full pass forwards and backwards, as in training."""
    forward, backward = [], []
    for _ in range(iterations):
        net.clear_param_diffs()
        begin = time.perf_counter()
        net.run_forward()
        middle = time.perf_counter()
        net.run_backward()
        forward.append(middle - begin)
        backward.append(time.perf_counter() - middle)
    return float(np.median(forward)), float(np.median(backward))


def memory_of(net: Net) -> list[tuple[str, int]]:
    """Bytes that are stored (parameters, whole blobs, blobs of shards), then bytes that are not."""
    hidden = {id(blob) for blob in net.executor.hidden()}
    rows = [("parameters and their diffs", sum(2 * p.blob.data.nbytes for p in net.learnable))]
    for name, blob in net.blobs.items():
        if id(blob) not in hidden:
            stored = sum(array.nbytes for array in (blob._data, blob._diff) if array is not None)
            rows.append((f"blob {name} {'x'.join(map(str, blob.shape))}", stored))
    kept: dict[int, int] = {}
    for step in net.executor.steps:
        for piece in step.pieces():
            if len(piece) == 1:
                continue
            for at in piece:
                for blob in [*at.bottom, *at.top]:
                    if blob._data is not None:
                        kept[id(blob)] = blob._data.nbytes
    rows.append(("hidden blobs kept for backward, all shards", sum(kept.values())))
    whole = sum(2 * blob.count * blob.dtype.itemsize for blob in net.blobs.values() if id(blob) in hidden)
    rows.append(("not stored: the whole of the hidden blobs", whole))
    return rows
