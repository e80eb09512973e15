"""Measurements of a net for the commands test_net, time and caffe: mean outputs, seconds per layer
and pass, bytes per blob.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable

import numpy as np

from netlib.engine import Connection
from netlib.net import Net
from netlib.snapshots import snapshot
from netlib.training import report
from tools.common.console import notify


@np.errstate(all="ignore")  # as in a pass of the net
def time_layers(net: Net, iterations: int) -> tuple[dict[str, float], dict[str, float]]:
    """Mean seconds of each layer forwards and backwards, on one thread."""
    forward: dict[str, float] = defaultdict(float)
    backward: dict[str, float] = defaultdict(float)
    threads = net.engine.threads()
    net.engine.set_threads(1)
    try:
        for _ in range(iterations):
            _add_times(net, iterations, forward, backward)
    finally:
        net.engine.set_threads(threads)
    return forward, backward


def _add_times(
    net: Net, iterations: int, forward: dict[str, float], backward: dict[str, float]
) -> None:
    """Run one pass and add its part of the mean seconds of each layer."""
    pieces = [piece for step in net.steps for piece in step.pieces()]
    for piece in pieces:
        for at in piece:
            begin = time.perf_counter()
            # with the fast engine: an earlier layer computes it
            if not getattr(at.layer, "is_fused", False):
                at.layer.forward(at.bottom, at.top)
            forward[at.layer.name] += (time.perf_counter() - begin) / iterations
        # the next slice of the batch reuses the memory of this one: run it backwards now
        if len(piece) > 1:
            _add_backward_times(piece, iterations, backward)
    for piece in reversed(pieces):
        if len(piece) == 1:
            _add_backward_times(piece, iterations, backward)


def _add_backward_times(
    piece: list[Connection], iterations: int, backward: dict[str, float]
) -> None:
    """Run some layers backwards and add their part of the mean seconds."""
    for at in reversed(piece):
        if at.needs_backward:
            for param in at.layer.blobs:
                param.diff.fill(0)
            begin = time.perf_counter()
            at.layer.backward(at.top, at.propagate_down, at.bottom)
            backward[at.layer.name] += (time.perf_counter() - begin) / iterations


def warn_of_another_net(weights: str, net: Net) -> None:
    """Print a warning if the file ``weights`` names another net than ``net``.

    Raises WeightsError.
    """
    name = snapshot.net_name(weights)
    if name and net.name and name != net.name:
        notify(
            f"warning: {weights}: the weights are of the net {name!r}, {net.source} is {net.name!r}"
        )


def memory_of(net: Net) -> list[tuple[str, int]]:
    """(Description, bytes) of the parameters, and of each blob that the engine stores for the
    whole batch.
    """
    unstored = {blob for step in net.steps for blob in step.unstored}
    params = sum(2 * param.blob.data.nbytes for param in net.learnable)
    rows = [("parameters and their diffs", params)]
    for name, blob in net.blobs.items():
        if blob not in unstored:
            rows.append((f"blob {name} {'x'.join(map(str, blob.shape))}", blob.allocated_bytes))
    return rows


def mean_scores(
    net: Net,
    iterations: int,
    on_value: Callable[[int, str, float], object] = lambda batch, name, value: None,
) -> tuple[float, list[str]]:
    """The mean loss over batches, and a line with the mean of each output.

    ``on_value(batch, name, value)`` is called with each value of each batch. Raises NetlibError.
    """
    loss = 0.0
    sums = {name: np.zeros(0) for name in net.outputs}
    for i in range(iterations):
        loss += net.run_forward()
        for name in net.outputs:
            values = net.blobs[name].data.ravel().astype(np.float64)
            sums[name] = sums[name] + values if i else values
            for value in values:
                on_value(i, name, value)
    means = {name: total / iterations for name, total in sums.items()}
    return loss / iterations, list(report.scores(net, means))


def report_time(net: Net, iterations: int, write: Callable[..., object]) -> tuple[float, float]:
    """Time full passes as in training, then each layer on one thread; returns the seconds of a pass
    forwards and backwards. Raises NetlibError.

    write  called with the cells of each line; the lines are those of ``caffe time``
    """
    write("Performing Forward")
    write(f"Initial loss: {net.run_forward():.6g}")
    write("Performing Backward")
    net.run_backward()
    write("*** Benchmark begins ***")
    write(f"Testing for {iterations} iterations.")
    passes = np.zeros((iterations, 2))  # seconds forwards and backwards
    for i in range(iterations):
        net.clear_param_diffs()
        begin = time.perf_counter()
        net.run_forward()
        forward_end = time.perf_counter()
        net.run_backward()
        passes[i] = forward_end - begin, time.perf_counter() - forward_end
        write(f"Iteration: {i + 1} forward-backward time: {passes[i].sum() * 1e3:.6g} ms.")
    directions = dict(zip(("forward", "backward"), time_layers(net, iterations)))
    write("Average time per layer: ")
    for layer in net.layers:
        for what, seconds in directions.items():
            write(f"{layer.name:>10}", f"{what}: {seconds[layer.name] * 1e3:.6g} ms.")
    forward, backward = passes.mean(axis=0)
    means = {
        "Forward pass": forward,
        "Backward pass": backward,
        "Forward-Backward": forward + backward,
    }
    for what, seconds in means.items():
        write(f"Average {what}: {seconds * 1e3:.6g} ms.")
    write(f"Total Time: {passes.sum() * 1e3:.6g} ms.")
    write("*** Benchmark ends ***")
    return float(forward), float(backward)
