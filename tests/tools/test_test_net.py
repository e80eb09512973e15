"""tools/test_net.py: the mean outputs of a net on its test data."""

from __future__ import annotations

from pathlib import Path

import pytest

import netlib
from tests.support.nets import X
from tests.support.running import run_tool

CAFFE_LOSS = 2.68399  # printed by Caffe for the same net, weights and batches


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
    title, _, total = first.rpartition(" ")
    assert title == "init.caffemodel: 3 batches, loss"
    assert second.startswith("init.caffemodel: 3 batches, ")
    name, equals, mean, *_ = output.split()
    assert (name, equals) == ("loss", "=")
    assert [float(total), float(mean)] == pytest.approx([CAFFE_LOSS] * 2, abs=2e-5)


def test_layers_without_weights_are_reported(tmp_path: Path) -> None:
    net = tmp_path / "net.prototxt"
    net.write_text(Path("net.prototxt").read_text().replace('name: "ip2"', 'name: "other"'))
    done = run_tool("test_net", net, "init.caffemodel", "--iterations", "1")
    assert done.err == "init.caffemodel has no weights for other; they keep their values\n"


def test_weights_of_another_net_are_reported(tmp_path: Path) -> None:
    """Weights that name another net than the prototxt give a warning; those that name the
    same give none.
    """
    weights = tmp_path / "own.caffemodel.h5"
    netlib.Net("net.prototxt", "init.caffemodel", netlib.TEST).save(weights)
    assert run_tool("test_net net.prototxt", weights, "--iterations", "1").err == ""

    other = tmp_path / "other.prototxt"
    text = Path("net.prototxt").read_text()
    other.write_text(text.replace('name: "small"', 'name: "other"', 1))
    done = run_tool("test_net", other, weights, "--iterations", "1")
    assert done.err == (
        f"warning: {weights}: the weights are of the net 'small', {other} is 'other'\n"
    )


def test_a_net_with_an_input_is_rejected(here: Path) -> None:
    Path("deploy.prototxt").write_text(X)
    done = run_tool("test_net", "deploy.prototxt", "init.caffemodel", status=1)
    assert "the caller provides the input 'x'; expected a net that reads its test data" in done.err
