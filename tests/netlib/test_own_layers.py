"""Layers of one's own, and layers whose names or options cannot be: each mistake is one line with its place."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib import prototxt

SQUARE = """
import netlib

class Square(netlib.Layer):
    def setup(self, bottom, top):
        self.factor = float(self.param_str or 1)

    def reshape(self, bottom, top):
        top[0].reshape(*bottom[0].shape)

    def forward(self, bottom, top):
        top[0].data[...] = self.factor * bottom[0].data ** 2

    def backward(self, top, propagate_down, bottom):
        if propagate_down[0]:
            bottom[0].diff[...] = 2 * self.factor * bottom[0].data * top[0].diff

class Broken(Square):
    def forward(self, bottom, top):
        1 / 0

class Stranger:
    pass
"""


def net_with(layer: str) -> netlib.Net:
    text = 'force_backward: true layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 } } } '
    return netlib.Net(prototxt.parse(text + layer, "f"), netlib.TRAIN)


def python(name: str, module: str = "squares", more: str = "") -> str:
    param = f'python_param {{ module: "{module}" layer: "{name}" {more} }}'
    return f'layer {{ name: "own" type: "Python" bottom: "x" top: "y" {param} }}'


@pytest.fixture
def squares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "squares.py").write_text(SQUARE)
    (tmp_path / "nonsense.py").write_text("def")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "squares", raising=False)


def test_a_python_layer(squares: None) -> None:
    """Caffe's protocol: four methods, param_str."""
    net = net_with(python("Square", more='param_str: "3"'))
    assert net.forward(x=np.array([1, 2, 3]))["y"].tolist() == [3, 12, 27]
    assert net.backward(y=np.ones(3))["x"].tolist() == [6, 12, 18]


def test_a_python_layer_may_keep_its_parameters_arrays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Caffe's diffs stay where they are: what is added to them after clear_param_diffs is the gradient."""
    (tmp_path / "keeper.py").write_text("""
import netlib

class Keeper(netlib.Layer):
    def setup(self, bottom, top):
        self.blobs.add_blob(3)
        self.gradient = self.blobs[0].diff
    def reshape(self, bottom, top):
        top[0].reshape(*bottom[0].shape)
    def forward(self, bottom, top):
        top[0].data[...] = bottom[0].data + self.blobs[0].data
    def backward(self, top, propagate_down, bottom):
        self.gradient += top[0].diff
""")
    monkeypatch.syspath_prepend(tmp_path)
    net = net_with(python("Keeper", "keeper"))
    for _ in range(2):
        net.clear_param_diffs()
        net.forward(x=np.zeros(3))
        net.backward(y=np.array([1, 2, 3]))
        assert net.params["own"][0].diff.tolist() == [1, 2, 3]


@pytest.mark.parametrize("package", ["layers", "tools"])
@pytest.mark.parametrize("file", ["{0}/data_layer.py", "{0}.py", "{0}/__init__.py"])
def test_a_module_with_the_name_of_one_of_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, file: str
) -> None:
    """Public nets say ``module: "layers.data_layer"`` or ``module: "layers"``: the user's file is found beside ours."""
    path = tmp_path / file.format(package)
    path.parent.mkdir(exist_ok=True)
    path.write_text(SQUARE)
    monkeypatch.chdir(tmp_path)
    __import__(package)
    folders = sys.modules[package].__path__
    monkeypatch.setattr(sys.modules[package], "__path__", list(folders))
    monkeypatch.delitem(sys.modules, "layers.data_layer", raising=False)
    monkeypatch.delitem(sys.modules, "tools.data_layer", raising=False)
    module = f"{package}.data_layer" if "data_layer" in file else package
    assert net_with(python("Square", module)).forward(x=np.array([1, 2, 3]))["y"].tolist() == [1, 4, 9]


def test_a_python_layer_may_derive_from_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its options are those of a Python layer."""
    (tmp_path / "steeper.py").write_text("""
from layers.activation.tanh import TanH

class Steeper(TanH):
    def forward(self, bottom, top):
        super().forward(bottom, top)
        top[0].data[...] *= 2
""")
    monkeypatch.syspath_prepend(tmp_path)
    net = net_with(python("Steeper", "steeper"))
    assert np.allclose(net.forward(x=np.array([0, 1, -2]))["y"], 2 * np.tanh([0, 1, -2]))


def test_a_python_layer_that_fails(squares: None) -> None:
    """The layer, what happened, and the line of the file it happened in."""
    net = net_with(python("Broken"))
    message = r"layer 'own': forward failed: ZeroDivisionError: division by zero \(squares.py:20\)$"
    with pytest.raises(netlib.LayerError, match=message):
        net.forward(x=np.ones(3))


@pytest.mark.parametrize(
    ("layer", "message"),
    [
        (python("Nobody"), r"squares.Nobody has no such class \(.*squares.py\)"),
        (python("Stranger"), "squares.Stranger is not a subclass of netlib.Layer"),
        (python("Square", module="missing"), "cannot import 'missing' .ModuleNotFoundError"),
        (python("Square", module="nonsense"), "cannot import 'nonsense' .SyntaxError"),
        (
            'layer { name: "own" type: "Python" bottom: "x" top: "y" }',
            "layer 'own' of type 'Python' needs a python_param",
        ),
    ],
)
def test_a_python_layer_that_is_not_there(squares: None, layer: str, message: str) -> None:
    """The module or class, and where it was looked for."""
    with pytest.raises(netlib.PrototxtError, match=message):
        net_with(layer)


@pytest.mark.parametrize("name", ["", "/", ".", "a//b", "/a", "a/", "a/0", "\\000"])
def test_a_name_that_hdf5_cannot_hold(name: str, tmp_path: Path) -> None:
    """Caffe takes any name, and so does its binary format; HDF5 says which layer, unless that has no parameters."""
    options = "inner_product_param { num_output: 1 axis: 0 }"
    layer = f'layer {{ name: "{name}" type: "%s" bottom: "x" top: "y" {options} }}'
    net = net_with(layer % "InnerProduct")
    net.save(tmp_path / "w.caffemodel")
    net.copy_from(tmp_path / "w.caffemodel")
    with pytest.raises(netlib.WeightsError, match=r"^layer '.*': .*HDF5.*; expected another name, or snapshot_format"):
        net.save(tmp_path / "w.caffemodel.h5")
    net_with(layer % "ReLU").save(tmp_path / "w.caffemodel.h5")


def test_a_missing_options_block() -> None:
    """Required options are missed at the layer."""
    with pytest.raises(netlib.PrototxtError, match="missing required field 'num_output' in inner_product_param"):
        net_with('layer { name: "ip" type: "InnerProduct" bottom: "x" top: "y" }')
