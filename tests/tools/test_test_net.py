"""tools/test_net.py: the mean outputs of a net on its test data."""

from __future__ import annotations

from pathlib import Path

import pytest

import netlib
from tests.support.nets import X
from tests.support.running import run_tool


@pytest.fixture(autouse=True)
def solvers(caffe_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Change to the folder of a net that Caffe trained, with data and weights."""
    monkeypatch.chdir(caffe_data / "solvers")


def test_the_means_of_the_batches() -> None:
    """Loss and outputs are means over the batches, as Caffe printed them, with the
    weights of each file.
    """
    done = run_tool("test_net net.prototxt init.caffemodel init.caffemodel --iterations 3")
    first, output, second, _ = done.out.splitlines()
    assert first.startswith("init.caffemodel: 3 batches, loss ")
    assert second.startswith("init.caffemodel: 3 batches, ")
    assert output.split()[:2] == ["loss", "="]
    assert [float(first.split()[-1]), float(output.split()[2])] == pytest.approx(
        [2.68399] * 2, abs=2e-5
    )


def test_layers_without_weights_are_reported(tmp_path: Path) -> None:
    (tmp_path / "net.prototxt").write_text(
        Path("net.prototxt").read_text().replace('name: "ip2"', 'name: "other"')
    )
    done = run_tool("test_net", tmp_path / "net.prototxt", "init.caffemodel", "--iterations", "1")
    assert done.err == "init.caffemodel has no weights for other; they keep their values\n"


def test_weights_of_another_net_are_reported(tmp_path: Path) -> None:
    """Weights that name another net than the prototxt give a warning; those that name the
    same give none.
    """
    netlib.Net("net.prototxt", "init.caffemodel", netlib.TEST).save(tmp_path / "own.caffemodel.h5")
    text = Path("net.prototxt").read_text()
    (tmp_path / "other.prototxt").write_text(text.replace('name: "small"', 'name: "other"', 1))
    assert (
        run_tool("test_net net.prototxt", tmp_path / "own.caffemodel.h5", "--iterations", "1").err
        == ""
    )
    done = run_tool(
        "test_net", tmp_path / "other.prototxt", tmp_path / "own.caffemodel.h5", "--iterations", "1"
    )
    place, message = done.err.split(": the weights are of ")
    assert place == f"warning: {tmp_path}/own.caffemodel.h5"
    assert message == f"the net 'small', {tmp_path}/other.prototxt is 'other'\n"


def test_mistakes(here: Path) -> None:
    Path("deploy.prototxt").write_text(X)
    done = run_tool("test_net", "deploy.prototxt", "init.caffemodel", status=1)
    assert "the caller provides the input 'x'; expected a net that reads its test data" in done.err
