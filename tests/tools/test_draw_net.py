"""tools/draw_net.py: Caffe's command line."""

from pathlib import Path

import pytest

from tests.support.running import run_tool

NET = Path(__file__).resolve().parents[2] / "prototxt" / "nyu_train_test.prototxt"
OLD = """
layers { name: "ip" type: INNER_PRODUCT bottom: "x" top: "ip" inner_product_param { num_output: 3 } }
input: "x" input_dim: 1 input_dim: 2 input_dim: 1 input_dim: 1
"""


def test_a_picture(here):
    pytest.importorskip("pydot")
    out = Path("net.raw")
    done = run_tool("draw_net", NET, out, "--phase", "TEST", "--rankdir", "TB", "--display_lrm")
    assert done.out == f"wrote {out}\n"
    # its data are not here
    assert done.err.startswith("without shapes: ")
    assert "writes it" in done.err
    text = out.read_text()
    assert "rankdir=TB" in text
    assert "HandModel" in text
    assert text.count('"data (HDF5Data)" ->') == 2
    assert "lr mult: 1.0, " in text


def test_graphvizs_own_language_needs_no_graphviz(here, monkeypatch):
    """A .dot file is written without the program dot, like a .raw file; layers of older
    prototxts are drawn.
    """
    pytest.importorskip("pydot")
    monkeypatch.setenv("PATH", str(here))
    Path("old.prototxt").write_text(OLD)
    for name in ("net.dot", "net.raw"):
        run_tool("draw_net", "old.prototxt", name)
    assert Path("net.dot").read_text() == Path("net.raw").read_text()
    assert '"ip\\n(InnerProduct)" -> ip [label="1 x 3"];' in Path("net.raw").read_text()
    assert (
        "the formats raw and dot do not need it" in run_tool("draw_net", NET, "a.png", status=1).err
    )


def test_shapes_and_out(here):
    """--out is the second argument; edges have the shapes of the blobs."""
    pytest.importorskip("pydot")
    Path("old.prototxt").write_text(OLD)
    done = run_tool("draw_net", "old.prototxt", "--out", "net.dot")
    assert not done.err
    assert '-> ip [label="1 x 3"];' in Path("net.dot").read_text()
    assert "one of the arguments" in run_tool("draw_net", "old.prototxt", status=2).err
