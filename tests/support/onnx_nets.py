"""Small nets as ONNX files, shared by the tests of the export."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from export.onnx.net import onnx_image
from netlib.files.paths import ROOT
from tests.support.nets import inputs

NYU = ROOT / "prototxt" / "nyu_deploy.prototxt"
SYNTHETIC = ROOT / "models" / "synthetic_hand"
IMAGE = (1, 3, 7, 6)  # the shape of an input that is an image


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


def check_older(net: netlib.Net, cube_mm: float | None = None) -> None:
    """Check that the file of opset 13 computes the same numbers as that of opset 17."""
    rng = np.random.default_rng(0)
    shapes = {name: (3, *net.blobs[name].shape[1:]) for name in net.inputs}
    values = {name: rng.uniform(0, 1, shape).astype(np.float32) for name, shape in shapes.items()}
    images = [onnx_image(net, cube_mm=cube_mm, opset=opset) for opset in (13, 17)]
    older, newer = (run_onnx(image, **values) for image in images)
    assert older.keys() == newer.keys()
    assert all(np.array_equal(older[name], newer[name], equal_nan=True) for name in newer)
