"""benchmarks/nets.py: ordinary nets are compared with the peers that are installed, after their values."""

from __future__ import annotations

import builtins
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from benchmarks import nets
from benchmarks.ordinary_nets import NETS, Ordinary, Text
from netlib import fillers
from netlib.proto import prototxt
from tests.support.running import run_tool


def two_layers() -> Text:
    """A small net for a forward pass, with every kind of layer that a peer translates."""
    net = Text(2, 3, 17, 17)
    x = net.pool(net.norm(net.conv("data", 8, 3, norm=True)), 3, 2)
    x = net.add("Concat", [net.conv(x, 4, 1), net.conv(x, 4, 3, pad=1, group=2)])
    x = net.add("Eltwise", [x, net.conv(x, 8, 3, pad=1, group=8, relu=False)])
    net.product(net.pool(x, 0, 1, kind="AVE"), 5)
    return net


@pytest.fixture(autouse=True)
def idle(keep_threads: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine counts as idle, the number of threads is restored, and the nets are small."""
    monkeypatch.setattr(nets.os, "getloadavg", lambda: (0.0, 0.0, 0.0))
    small = [one for one in NETS if one.name == "LeNet"]
    monkeypatch.setattr(nets, "NETS", (Ordinary("two-layers", two_layers), *small))
    nets._noted.clear()


def test_all_peers(tmp_path: Path) -> None:
    """There is a row for each peer, on the screen and as JSON."""
    pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")
    file = tmp_path / "speed.json"
    _, out, err = run_tool("benchmarks.nets", "--rounds", "1", "--threads", "1", "--json", file)
    assert err == ""
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    peers = [row["peer"].split()[0] for row in rows]
    assert peers == ["OpenCV", "onnxruntime", "PyTorch", "PyTorch", "PyTorch"]
    assert len(out.splitlines()) == 1 + len(rows)
    assert all(row[key] > 0 for row in rows for key in ("netlib_ms", "peer_ms", "ratio"))


def test_without_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Missing packages are named once; what needs none of them is timed, and the status is 0."""
    true_import = builtins.__import__

    def without(name: str, *args: Any, **options: Any) -> Any:
        if name.split(".")[0] in ("torch", "onnxruntime", "onnx"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name.split(".")[0])
        return true_import(name, *args, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    monkeypatch.delitem(nets.sys.modules, "benchmarks.torch_graph", raising=False)
    _, out, err = run_tool("benchmarks.nets", "--rounds", "1", "--threads", "1", "--cpu")
    assert err.count("without PyTorch") == 1
    assert "forward two-layers, batch 2" in out
    assert "training LeNet, batch 64" in out


def test_a_peer_that_differs(capsys: pytest.CaptureFixture[str]) -> None:
    """Values that differ are reported."""
    assert nets.agrees("a peer", np.ones(3), np.ones((1, 3)))
    assert not nets.agrees("a peer", np.ones(3), np.array([1, 1, 1.01]))
    assert "a peer is not timed: its values differ by 0.0099" in capsys.readouterr().err


@pytest.mark.parametrize("one", NETS, ids=lambda one: one.name)
def test_the_nets(one: Ordinary, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each net has one output, and about as many parameters as published."""
    monkeypatch.setattr(fillers, "_draw", lambda array, draw: None)  # the values do not matter, and take seconds
    known = {"CaffeNet": 61.0, "GoogLeNet": 7.0, "SqueezeNet": 1.24, "MobileNet-v1": 4.25, "MobileNet-v2": 3.54,
             "ResNet-50": 25.6, "VGG-16": 138.4, "LeNet": 0.43, "CIFAR-10": 0.146}
    net = netlib.Net(prototxt.parse("\n".join(one.text().lines)), netlib.TRAIN if one.trains else netlib.TEST)
    assert len(net.outputs) == 1
    count = sum(param.count for params in net.params.values() for param in params) / 1e6
    assert count == pytest.approx(known.get(one.name, count), rel=0.01)
