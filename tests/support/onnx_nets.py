"""Small nets as ONNX files, shared by the tests of the export."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import netlib
from export.onnx.check import differences
from export.onnx.net import load, onnx_image
from netlib.files.paths import ROOT
from tests.support.nets import inputs

NYU = ROOT / "prototxt" / "nyu_deploy.prototxt"
SYNTHETIC = ROOT / "models" / "synthetic_hand"
IMAGE = [(1, 3, 7, 6)]  # the shape of an input x that is an image

Shapes = list[tuple[int, ...]]
# layer type -> some inputs' shapes, options, number of tops
Cases = dict[str, list[tuple[Shapes, str, int]]]
Files = Callable[..., tuple[str, str]]  # the fixture of this name


def net_text(layers: str, *shapes: tuple[int, ...]) -> str:
    """Return a net with inputs x0, x1 ... of these shapes before its layers."""
    lines = [inputs(**{f"x{i}": shape}) for i, shape in enumerate(shapes)]
    return "\n".join(['name: "small"', *lines, layers, ""])


def run_onnx(image: bytes, **inputs: np.ndarray) -> dict[str, np.ndarray]:
    """Run an ONNX file and return all outputs."""
    onnxruntime = pytest.importorskip("onnxruntime")
    session = onnxruntime.InferenceSession(image, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(names, inputs)))


def examples(cases: Cases) -> list[Any]:
    """Return a test parameter for each example."""
    return [
        pytest.param(name, *case, id=f"{name}{i}")
        for name, of_it in cases.items()
        for i, case in enumerate(of_it)
    ]


def check(files: Files, name: str, shapes: Shapes, options: str, tops: int) -> None:
    """Check one layer with batches of 1 and 3: it agrees with netlib to 1e-6 of the
    largest value.
    """
    bottoms = " ".join(f'bottom: "x{i}"' for i in range(len(shapes) if name != "Parameter" else 0))
    names = " ".join(f'top: "y{i}"' for i in range(tops))
    also = (
        'layer { name: "read" type: "Sigmoid" bottom: "x0" top: "z" }'
        if name == "Parameter"
        else ""
    )
    net = load(
        *files(f'layer {{ name: "it" type: "{name}" {bottoms} {names} {options} }} {also}', *shapes)
    )
    outputs, layers = differences(onnx_image(net), net, (1, 3))
    assert set(outputs) >= {f"y{i}" for i in range(tops)}
    check_older(net)
    assert max(difference.found for difference in [*outputs.values(), *layers.values()]) <= 1e-6, (
        outputs,
        layers,
    )


def check_older(net: netlib.Net, cube_mm: float | None = None) -> None:
    """Check that the file of opset 13 computes the same numbers as that of opset 17."""
    rng = np.random.default_rng(0)
    shapes = {name: (3, *net.blobs[name].shape[1:]) for name in net.inputs}
    values = {name: rng.uniform(0, 1, shape).astype(np.float32) for name, shape in shapes.items()}
    images = [onnx_image(net, cube_mm=cube_mm, opset=opset) for opset in (13, 17)]
    older, newer = (run_onnx(image, **values) for image in images)
    assert older.keys() == newer.keys()
    assert all(np.array_equal(older[name], newer[name], equal_nan=True) for name in newer)
