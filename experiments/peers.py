"""The peers of the benchmark: the same nets, with the same weights, in other programs."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np

import netlib
from experiments.workload import Workload
from export.onnx.net import onnx_image
from netlib.blob import Array
from netlib.net import Net
from tools.common.console import notify

Job = Callable[[], object]
TOLERANCE = 1e-3  # of the largest value
# Where the input of a ReLU is zero up to rounding, either gradient is right.
GRADIENT_TOLERANCE = 2e-2


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
    notify(f"without {package}: pip install -e '.[bench]'")


def agrees(what: str, found: Array, expected: Array, tolerance: float = TOLERANCE) -> bool:
    """Whether a peer's values are ours, up to a tolerance relative to the largest; otherwise print
    that it is not timed.
    """
    largest = max(np.abs(expected).max(), 1e-30)
    error = float(np.abs(np.ravel(found) - np.ravel(expected)).max() / largest)
    if error < tolerance:
        return True
    notify(
        f"{what} is not timed: its values differ by {error:.2g} of the largest, expected below {tolerance:g}"
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
        notify(f"{peer}, {name}, is not timed: {str(error).strip().splitlines()[-1]}")
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
        return peer.forward()

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
            return graph(**inputs).numpy()

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
