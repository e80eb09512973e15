"""tools/demo.py: frames, and a picture of what was found in them."""

import cv2
import numpy as np

from handpose.data.images import read_frame
from handpose.facts.cameras import NYU
from tools import demo


def test_demo(tmp_path, capsys):
    """Two depth frames that read back, one picture of both, and the command to go on with."""
    assert demo.main(["--out", str(tmp_path / "d"), "--frames", "2"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("2 frames in ") and "python tools/predict.py" in out
    depth = read_frame(tmp_path / "d" / "frame_1.png", NYU)
    assert depth.shape == (480, 640) and 300 < np.median(depth[depth > 0]) < 3000
    assert cv2.imread(str(tmp_path / "d" / "hands.png")).shape[1] > 6 * 256


def test_nowhere_to_write(tmp_path, capsys):
    """Is one line."""
    (tmp_path / "file").touch()
    assert demo.main(["--out", str(tmp_path / "file" / "d")]) == 1
    assert "expected a folder" in capsys.readouterr().err
