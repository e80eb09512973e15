"""tools/time.py: the lines of ``caffe time``, and where memory goes."""

import re

from tools import time


def test_lines_are_caffes(work, capsys):
    """Every layer forwards and backwards, and the averages of whole passes."""
    assert time.main(["net.prototxt", "--iterations", "1"]) == 0
    out = capsys.readouterr().out
    for name in ("convL1", "poolL1", "FC1", "HandModel"):
        assert re.search(rf"^ *{name}\tforward: [\d.e-]+ ms\.$", out, re.MULTILINE)
        assert re.search(rf"^ *{name}\tbackward: [\d.e-]+ ms\.$", out, re.MULTILINE)
    assert re.search(r"^Average Forward-Backward: [\d.]+ ms\.$", out, re.MULTILINE)


def test_memory(work, capsys):
    """Whole blobs are listed with their size, hidden ones are not stored."""
    assert time.main(["net.prototxt", "--memory"]) == 0
    out = capsys.readouterr().out
    assert re.search(r" 1\.00 MiB  blob depth 16x1x128x128$", out, re.MULTILINE)
    assert "convL1" not in out and "not stored: the whole of the hidden blobs" in out


def test_mistakes(capsys):
    """A net that is not there."""
    assert time.main(["nothing.prototxt"]) == 1
    assert capsys.readouterr().err == "nothing.prototxt: cannot read the prototxt: No such file or directory\n"
