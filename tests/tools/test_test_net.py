"""tools/test_net.py: the mean outputs of a net on its test data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import netlib
from tests.support.nets import X
from tests.support.running import run_tool


@pytest.fixture(autouse=True)
def solvers(caffe_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Change to the folder of a net that Caffe trained, with data and weights."""
    monkeypatch.chdir(caffe_data / "solvers")


def test_the_means_of_the_batches() -> None:
    """Loss and outputs are means over the batches, with the weights of each file."""
    lines = run_tool("test_net", "net.prototxt", "init.caffemodel", "init.caffemodel", "--iterations", "3").out
    net = netlib.Net("net.prototxt", "init.caffemodel", netlib.TEST)
    losses, outputs = [], []
    for _ in range(3):
        losses.append(net.run_forward())
        outputs.append(np.concatenate([net.blobs[name].data.ravel() for name in net.outputs]))
    first, *scores = lines.splitlines()[: 1 + outputs[0].size]
    name, _, loss = first.partition(": 3 batches, loss ")
    assert name == "init.caffemodel" and float(loss) == pytest.approx(np.mean(losses), rel=1e-5)
    assert [float(line.split()[2]) for line in scores] == pytest.approx(np.mean(outputs, axis=0), rel=1e-4)
    assert [line.split()[0] for line in scores] == net.outputs
    assert lines.count("init.caffemodel: ") == 2


def test_layers_without_weights_are_reported(tmp_path: Path) -> None:
    (tmp_path / "net.prototxt").write_text(Path("net.prototxt").read_text().replace('name: "ip2"', 'name: "other"'))
    done = run_tool("test_net", tmp_path / "net.prototxt", "init.caffemodel", "--iterations", "1")
    assert done.err == "init.caffemodel has no weights for other; they keep their values\n"


def test_weights_of_another_net_are_reported(tmp_path: Path) -> None:
    """Weights that name another net than the prototxt give a warning; those that name the same give none."""
    netlib.Net("net.prototxt", "init.caffemodel", netlib.TEST).save(tmp_path / "own.caffemodel.h5")
    text = Path("net.prototxt").read_text()
    (tmp_path / "other.prototxt").write_text(text.replace('name: "small"', 'name: "other"', 1))
    assert run_tool("test_net", "net.prototxt", tmp_path / "own.caffemodel.h5", "--iterations", "1").err == ""
    done = run_tool("test_net", tmp_path / "other.prototxt", tmp_path / "own.caffemodel.h5", "--iterations", "1")
    place, message = done.err.split(": the weights are of ")
    assert place == f"warning: {tmp_path}/own.caffemodel.h5"
    assert message == f"the net 'small', {tmp_path}/other.prototxt is 'other'\n"


def test_mistakes(tmp_path: Path) -> None:
    (tmp_path / "deploy.prototxt").write_text(X)
    done = run_tool("test_net", tmp_path / "deploy.prototxt", "init.caffemodel", status=1)
    assert "the caller provides the input 'x'; expected a net that reads its test data" in done.err
