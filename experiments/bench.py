"""Benchmark of this project against PyTorch, onnxruntime and OpenCV, with the same
nets and weights.

    python -m experiments bench                                   the time, all nets
    python -m experiments bench --cpu --threads 1 --nets LeNet    processor time, on a busy machine

The forward pass of nine well-known nets, of six kinds of small ones, and of the paper's network,
which is called "hand", for 1, 64 and 512 images; a training step of four small nets and of the
paper's network. Outputs and gradients are compared first, and a peer that differs is not timed.
Each net is timed alternately with its peers; the table has the medians, and the ratio: the peer's
time divided by ours (above 1: this project is faster). A package that is not installed is left out.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import netlib
from experiments.example_nets import NETS, Workload
from export.onnx.net import onnx_image
from netlib.blob import Array
from netlib.net import Net
from tools.common.arguments import positive, workers
from tools.common.console import DONE, say

Job = Callable[[], object]
TOLERANCE = 1e-3  # of the largest value
# Where the input of a ReLU is zero up to rounding, either gradient is right.
GRADIENT_TOLERANCE = 2e-2
MAX_LOAD = 0.5  # of a machine on which times are reproducible
MIN_JOB_S = 0.1  # for which a job is repeated
# before a job: OpenMP's threads, PyTorch's and OpenCV's, spin for some ms after the job before
PAUSE_S = 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--nets",
        nargs="+",
        choices=NETS,
        default=list(NETS),
        metavar="NAME",
        help=f"some of {', '.join(NETS)} (default: all)",
    )
    parser.add_argument(
        "--rounds", type=positive, default=7, metavar="N", help="number of timings (default: 7)"
    )
    parser.add_argument(
        "--threads",
        type=workers,
        default=min(2, netlib.threads()),
        metavar="N",
        help="default: %(default)s",
    )
    parser.add_argument(
        "--cpu", action="store_true", help="processor time instead of the time, for a busy machine"
    )


def run(args: argparse.Namespace) -> int:
    """Time the nets and print a line for each peer."""
    netlib.set_threads(args.threads)
    cv2.setNumThreads(args.threads)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    if load > MAX_LOAD and not args.cpu:
        say(
            f"warning: the machine is busy (load {load:.1f}); use --cpu and --threads 1",
            file=sys.stderr,
        )
    unit = "processor time" if args.cpu else "time"
    print(f"{netlib.BLAS_NOTE}; {args.threads} threads; medians of the {unit} in ms")
    print(f"{'':20}{'ours':>9}  {'peer':<24}{'':>9}{'ratio':>7}")
    with tempfile.TemporaryDirectory() as folder:
        for name in args.nets:
            work = Workload(NETS[name], Path(folder))
            peers = dict(peers_of(name, work, args.threads))
            ours, *theirs = medians([work.run, *peers.values()], args.rounds, args.cpu)
            line = f"{name:20}{1e3 * ours:9.2f}"
            for peer, seconds in zip(peers, theirs):
                print(f"{line}  {peer:<24}{1e3 * seconds:9.2f}{seconds / ours:7.2f}", flush=True)
            if not peers:
                print(line, flush=True)
    return DONE


def medians(jobs: list[Job], rounds: int, cpu: bool) -> list[float]:
    """The median times of jobs in s, run alternately; the first round is not counted."""
    clock = time.process_time if cpu else time.perf_counter
    times = np.zeros((rounds + 1, len(jobs)))
    for row in times:
        for number, job in enumerate(jobs):
            time.sleep(PAUSE_S)
            job()  # into the caches
            begun, count = clock(), 0
            while not count or clock() - begun < MIN_JOB_S:
                job()
                count += 1
            row[number] = (clock() - begun) / count
    return [float(value) for value in np.median(times[1:], axis=0)]


def peers_of(name: str, work: Workload, threads: int) -> Iterator[tuple[str, Job]]:
    """The peers that are installed and compute the same values, each with a function
    that runs it once.
    """
    if work.solver:
        makers = [_torch_training]
    elif len(work.inputs) > 1:  # a recurrent net
        makers = [_torch]
    else:
        makers = [_opencv, _onnxruntime, _torch]
    for make in makers:
        try:
            yield from make(name, work, threads)
        except ModuleNotFoundError as error:
            _note(str(error.name))


@functools.cache
def _note(package: str) -> None:
    """Print once that a package is missing."""
    say(f"without {package}: pip install -e '.[bench]'", file=sys.stderr)


def agrees(what: str, found: Array, expected: Array, tolerance: float = TOLERANCE) -> bool:
    """Whether a peer's values are ours, up to a tolerance relative to the largest; otherwise print
    that it is not timed.
    """
    largest = max(np.abs(expected).max(), 1e-30)
    error = float(np.abs(np.ravel(found) - np.ravel(expected)).max() / largest)
    if error < tolerance:
        return True
    say(
        f"{what} is not timed: its values differ by {error:.2g} of the largest, expected below {tolerance:g}",
        file=sys.stderr,
    )
    return False


# ----------------------------------------------------------------------------------- forward passes


def _checked(
    name: str, work: Workload, peer: str, job: Callable[[], Any]
) -> Iterator[tuple[str, Job]]:
    """The job of a peer if its output is ours."""
    expected = work.run()
    assert expected is not None
    try:
        found = np.asarray(job())
    except cv2.error as error:  # OpenCV 4 does not run every net that it reads
        say(f"{peer}, {name}, is not timed: {str(error).strip().splitlines()[-1]}", file=sys.stderr)
        return
    if agrees(f"{peer}, {name}", found, expected):
        yield peer, job


def _onnx(work: Workload) -> bytes:
    import onnx  # noqa: F401  (a missing package is a note here, an error in the export)

    # the plain layers store their options by name
    plain = Net(work.path, netlib.TEST, engine="plain")
    plain.copy_from(work.net)
    return onnx_image(plain)


def _opencv(name: str, work: Workload, threads: int) -> Iterator[tuple[str, Job]]:
    (x,) = work.inputs.values()
    if hasattr(cv2.dnn, "readNetFromCaffe") and not name.startswith("hand"):  # OpenCV 4
        weights = work.path.with_suffix(".caffemodel")
        work.net.save(weights)
        peer = cv2.dnn.readNetFromCaffe(str(work.path), str(weights))
    else:
        model = work.path.with_suffix(".onnx")
        model.write_bytes(_onnx(work))
        peer = cv2.dnn.readNetFromONNX(str(model))

    def job() -> Array:
        peer.setInput(x)
        return np.asarray(peer.forward())

    yield from _checked(name, work, f"OpenCV {cv2.__version__}", job)


def _onnxruntime(name: str, work: Workload, threads: int) -> Iterator[tuple[str, Job]]:
    import onnxruntime

    ((blob, x),) = work.inputs.items()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.add_free_dimension_override_by_name("N", len(x))
    session = onnxruntime.InferenceSession(_onnx(work), options, providers=["CPUExecutionProvider"])
    yield from _checked(name, work, "onnxruntime", lambda: session.run(None, {blob: x})[0])


def _torch(name: str, work: Workload, threads: int) -> Iterator[tuple[str, Job]]:
    import torch

    from experiments.torch_nets import TorchNet

    torch.set_num_threads(threads)
    graph = TorchNet(work.net).eval()
    inputs = {blob: torch.from_numpy(x) for blob, x in work.inputs.items()}

    def job() -> Array:
        with torch.inference_mode():
            return np.asarray(graph(**inputs).numpy())

    yield from _checked(name, work, "PyTorch", job)


# ----------------------------------------------------------------------------------- training steps


def _torch_training(name: str, work: Workload, threads: int) -> Iterator[tuple[str, Job]]:
    """PyTorch in both memory layouts, with SGD and momentum."""
    import torch

    from experiments.torch_nets import TorchNet

    torch.set_num_threads(threads)
    net = work.net
    with _without_dropout(net):
        net.run_forward()
        net.clear_param_diffs()
        net.run_backward()
    read = [top for layer in net.layers if not layer.spec.bottom for top in layer.spec.top]
    inputs = {blob: torch.from_numpy(net.blobs[blob].data.copy()) for blob in read}
    layouts = {"eager": torch.contiguous_format, "channels_last": torch.channels_last}
    for layout, memory_format in layouts.items():
        graph = TorchNet(net).eval().to(memory_format=memory_format)
        xs = {
            blob: x.to(memory_format=memory_format) if x.ndim == 4 else x
            for blob, x in inputs.items()
        }
        graph(**xs).backward()
        peer = f"PyTorch {layout}"
        gradients = (
            (key, param.grad.numpy(), net.params[key[0]][key[1]].diff)
            for key, param in graph.pairs.items()
        )
        what = f"{peer}, {name}, gradient"
        if all(
            agrees(f"{what} {key}", theirs, ours, GRADIENT_TOLERANCE)
            for key, theirs, ours in gradients
        ):
            optimiser = torch.optim.SGD(graph.parameters(), lr=0.0001, momentum=0.9)
            yield peer, functools.partial(_torch_step, graph.train(), xs, optimiser)


@contextlib.contextmanager
def _without_dropout(net: Net) -> Iterator[None]:
    """Context manager: dropout keeps all values, as its random numbers are not those of a peer."""
    layers: list[Any] = [layer for layer in net.layers if layer.type == "Dropout"]
    active = [layer for layer in layers if layer.active]
    for layer in active:
        layer.active = False
    try:
        yield
    finally:
        for layer in active:
            layer.active = True


def _torch_step(graph: Any, inputs: dict[str, Any], optimiser: Any) -> None:
    optimiser.zero_grad(set_to_none=True)
    graph(**inputs).backward()
    optimiser.step()
