#!/usr/bin/env python3
"""Time a net, layer by layer, as ``caffe time`` does; or say where its memory goes.

    python tools/time.py prototxt/nyu_train_test.prototxt --iterations 20
    python tools/time.py prototxt/nyu_train_test.prototxt --engine plain

Times of single layers are taken on one thread, as the engine runs them (fast: slice by slice, summed over the slices of
a batch); the passes below them run as in training, on all threads. --memory lists what the net holds after one pass.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # before NumPy: it chooses BLAS kernels

# isort: split

import numpy as np

from netlib import engine
from netlib.net import Net
from netlib.plain import Connection
from tools.console import DONE, guarded, positive
from tools.train import with_advice


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", metavar="MODEL", help="the net's prototxt")
    parser.add_argument("--iterations", type=positive, default=20, metavar="N", help="default: %(default)s")
    parser.add_argument("--phase", choices=("TRAIN", "TEST"), default="TRAIN", help="default: %(default)s")
    parser.add_argument("--threads", type=positive, metavar="N", help="threads (default: one per processor)")
    parser.add_argument("--engine", choices=engine.NAMES, help="default: fast, if it is there")
    parser.add_argument("--memory", action="store_true", help="list where memory goes instead")
    args = parser.parse_args(argv)
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> int:
    """Time as the parsed arguments say."""
    if args.threads:
        netlib.set_threads(args.threads)
    with with_advice():
        net = Net(args.model, netlib.TRAIN if args.phase == "TRAIN" else netlib.TEST, engine=args.engine)
    for name in net.inputs:
        net.blobs[name].data[...] = np.random.default_rng(0).uniform(-1, 1, net.blobs[name].shape)
    net.run_forward()
    net.run_backward()
    if args.memory:
        print_memory(net)
        return DONE
    print(f"Engine {net.engine.name}; {netlib.BLAS_NOTE}, {net.engine.threads()} threads")
    print("*** Benchmark begins ***")
    print(f"Testing for {args.iterations} iterations.")
    forward, backward = time_layers(net, args.iterations)
    print("Average time per layer:")
    for layer in net.layers:
        print(f"{layer.name:>16}\tforward: {forward[layer.name] * 1e3:.6g} ms.")
        print(f"{layer.name:>16}\tbackward: {backward[layer.name] * 1e3:.6g} ms.")
    passes = time_passes(net, args.iterations)
    for what, seconds in zip(("Forward pass", "Backward pass"), passes):
        print(f"Average {what}: {seconds * 1e3:.6g} ms.")
    print(f"Average Forward-Backward: {sum(passes) * 1e3:.6g} ms.")
    print(f"Total Time: {sum(passes) * args.iterations * 1e3:.6g} ms.")
    print("*** Benchmark ends ***")
    return DONE


def time_layers(net: Net, iterations: int) -> tuple[dict[str, float], dict[str, float]]:
    """Mean seconds of each layer forwards and backwards, on one thread."""
    forward: dict[str, float] = defaultdict(float)
    backward: dict[str, float] = defaultdict(float)
    threads = netlib.threads()
    netlib.set_threads(1)
    for _ in range(iterations):
        for step in net.executor.steps:
            for piece in step.pieces():
                for at in piece:
                    begin = time.perf_counter()
                    at.layer.forward(at.bottom, at.top)
                    forward[at.layer.name] += (time.perf_counter() - begin) / iterations
                if len(piece) > 1:  # a slice's own memory is only good until the next slice: backwards at once
                    _time_backward(net, piece, backward, iterations)
        for step in reversed(net.executor.steps):
            for piece in step.pieces():
                if len(piece) == 1:
                    _time_backward(net, piece, backward, iterations)
    netlib.set_threads(threads)
    return forward, backward


def _time_backward(net: Net, piece: list[Connection], backward: dict[str, float], iterations: int) -> None:
    for at in reversed(piece):
        if at.needs_backward:
            net.executor.clear_diffs(at.layer.blobs)
            begin = time.perf_counter()
            at.layer.backward(at.top, at.propagate_down, at.bottom)
            backward[at.layer.name] += (time.perf_counter() - begin) / iterations


def time_passes(net: Net, iterations: int) -> tuple[float, float]:
    """Median seconds of a whole pass forwards and backwards, as in training."""
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


def print_memory(net: Net) -> None:
    """What is stored: parameters, whole blobs, blobs of slices, working memory; and the process's peak."""
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
    rows.append(("hidden blobs that backward needs, all slices", sum(kept.values())))
    for what, size in rows:
        print(f"{size / 2**20:10.2f} MiB  {what}")
    whole = sum(2 * blob.count * blob.dtype.itemsize for blob in net.blobs.values() if id(blob) in hidden)
    print(f"{whole / 2**20:10.2f} MiB  not stored: the whole of the hidden blobs")
    print(f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10:10.2f} MiB  peak of the process")


if __name__ == "__main__":
    sys.exit(main())
