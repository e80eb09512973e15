"""tools/draw_net.py: Caffe's command line."""

from pathlib import Path

import pytest

from tools import draw_net

NET = Path(__file__).resolve().parents[2] / "prototxt" / "nyu_train_test.prototxt"
OLD = """
layers { name: "ip" type: INNER_PRODUCT bottom: "x" top: "ip" inner_product_param { num_output: 3 } }
input: "x" input_dim: 1 input_dim: 2 input_dim: 1 input_dim: 1
"""


def test_a_picture(tmp_path, capsys):
    """The layers of one phase, in the direction asked for."""
    pytest.importorskip("pydot")
    out = tmp_path / "net.raw"
    assert draw_net.main([str(NET), str(out), "--phase", "TEST", "--rankdir", "TB", "--display_lrm"]) == 0
    assert capsys.readouterr().out == f"wrote {out}\n"
    text = out.read_text()
    assert "rankdir=TB" in text and "HandModel" in text and text.count('"data (HDF5Data)" ->') == 2
    assert "lr mult: 1.0, " in text


def test_old_formats(tmp_path):
    """Layers of older prototxts are drawn as well; Caffe's own tool overlooks them."""
    pytest.importorskip("pydot")
    (tmp_path / "old.prototxt").write_text(OLD)
    assert draw_net.main([str(tmp_path / "old.prototxt"), str(tmp_path / "old.raw")]) == 0
    assert '"ip\\n(InnerProduct)" -> ip [label=3];' in (tmp_path / "old.raw").read_text()


def test_mistakes(tmp_path, capsys):
    """One line, and nothing written."""
    (tmp_path / "bad.prototxt").write_text('layer { nam: "x" }')
    assert draw_net.main([str(tmp_path / "bad.prototxt"), str(tmp_path / "net.raw")]) == 1
    error = capsys.readouterr().err
    assert "bad.prototxt:1:9: error: unknown field 'nam' (did you mean 'name'?)" in error and error.count("\n") == 1
    assert draw_net.main([str(tmp_path / "none.prototxt"), str(tmp_path / "net.raw")]) == 1
    assert "none.prototxt: cannot read the prototxt" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["bad.prototxt"]
    with pytest.raises(SystemExit) as stopped:
        draw_net.main([str(NET), "net.png", "--phase", "DEPLOY"])
    assert stopped.value.code == 2
