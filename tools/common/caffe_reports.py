"""The reports of ``caffe test`` and ``caffe time`` about a net."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from netlib.net import Net
from netlib.training import report
from tools.common.costs import time_layers, time_passes

log = logging.getLogger("netlib")


def report_test(net: Net, weights: str, iterations: int) -> None:
    """Log the outputs of each batch and their means, with weights from a file. Raises NetlibError."""
    report.copied(weights, *net.copy_from(weights))
    log.info("Running for %d iterations.", iterations)
    loss, sums = 0.0, {name: np.zeros(0) for name in net.outputs}
    for i in range(iterations):
        loss += net.run_forward()
        for name in net.outputs:
            values = net.blobs[name].data.ravel().astype(np.float64)
            sums[name] = sums[name] + values if i else values
            for value in values:
                log.info("Batch %d, %s = %.6g", i, name, value)
    log.info("Loss: %.6g", loss / iterations)
    for score in report.scores(net, {name: total / iterations for name, total in sums.items()}):
        log.info("%s", score)


def report_time(net: Net, iterations: int) -> None:
    """Log the time of each layer and of full passes. Raises NetlibError."""
    log.info("Performing Forward")
    log.info("Initial loss: %.6g", net.run_forward())
    log.info("Performing Backward")
    net.run_backward()
    log.info("*** Benchmark begins ***")
    log.info("Testing for %d iterations.", iterations)
    passes = []
    for i in range(iterations):
        passes.append(time_passes(net, 1))
        log.info("Iteration: %d forward-backward time: %.6g ms.", i + 1, sum(passes[-1]) * 1e3)
    for cells in [*layer_lines(net, iterations, width=10), *pass_lines(np.mean(passes, axis=0), iterations)]:
        log.info("\t".join(["%s"] * len(cells)), *cells)


def layer_lines(net: Net, iterations: int, width: int) -> Iterator[Sequence[str]]:
    """Time the layers; yields the cells of each line. Names are padded to ``width``."""
    forward, backward = time_layers(net, iterations)
    yield ["Average time per layer: "]
    for layer in net.layers:
        for what, seconds in (("forward", forward), ("backward", backward)):
            yield f"{layer.name:>{width}}", f"{what}: {seconds[layer.name] * 1e3:.6g} ms."


def pass_lines(passes: Iterable[float], iterations: int) -> Iterator[Sequence[str]]:
    """Lines about the mean seconds of forward and backward passes over a number of iterations, to the end."""
    forward, backward = passes
    costs = {"Forward pass": forward, "Backward pass": backward, "Forward-Backward": forward + backward}
    for what, seconds in costs.items():
        yield [f"Average {what}: {seconds * 1e3:.6g} ms."]
    yield [f"Total Time: {(forward + backward) * iterations * 1e3:.6g} ms."]
    yield ["*** Benchmark ends ***"]
