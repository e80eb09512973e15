"""Small nets as ONNX files: what their tests share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from export.onnx.net import differences, load, onnx_image
from export.onnx.table import LAYERS
from netlib.files.paths import ROOT
from netlib.proto.options import layer_types
from tests.support.nets import inputs

NYU = ROOT / "prototxt" / "nyu_deploy.prototxt"
SYNTHETIC = ROOT / "models" / "synthetic_hand"
IMAGE = [(1, 3, 7, 6)]  # the shape of an input x that is an image

Shapes = list[tuple[int, ...]]
Cases = dict[str, list[tuple[Shapes, str, int]]]  # layer type -> some inputs' shapes, options, number of tops
Files = Callable[..., tuple[str, str]]  # the fixture of this name


def net_text(layers: str, *shapes: tuple[int, ...]) -> str:
    """A net with inputs x0, x1 ... of these shapes before its layers."""
    lines = [inputs(**{f"x{i}": shape}) for i, shape in enumerate(shapes)]
    return "\n".join(['name: "small"', *lines, layers, ""])


def run_onnx(image: bytes, **inputs: np.ndarray) -> dict[str, np.ndarray]:
    """All outputs."""
    onnxruntime = pytest.importorskip("onnxruntime")
    session = onnxruntime.InferenceSession(image, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(names, inputs)))


def examples(cases: Cases) -> list[Any]:
    """One parameter set for each."""
    return [pytest.param(name, *case, id=f"{name}{i}") for name, of_it in cases.items() for i, case in enumerate(of_it)]


def types_of(room: str) -> set[str]:
    """The layer types with a form in ONNX that stand in this folder of layers/."""
    return {name for name in LAYERS if layer_types()[name].__module__.split(".")[1] == room}


def check(files: Files, name: str, shapes: Shapes, options: str, tops: int) -> None:
    """One layer, batches of 1 and 3: what netlib computes, to 1e-5 of the largest value."""
    bottoms = " ".join(f'bottom: "x{i}"' for i in range(len(shapes) if name != "Parameter" else 0))
    names = " ".join(f'top: "y{i}"' for i in range(tops))
    also = 'layer { name: "read" type: "Sigmoid" bottom: "x0" top: "z" }' if name == "Parameter" else ""
    net = load(*files(f'layer {{ name: "it" type: "{name}" {bottoms} {names} {options} }} {also}', *shapes))
    found = differences(onnx_image(net), net, (1, 3))
    assert set(found) >= {f"y{i}" for i in range(tops)}
    assert max(found.values()) <= 1e-5, found
