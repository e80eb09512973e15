"""handpose/datasets/nyu_files.py; more of it in the tests of the tools that use it"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from handpose.datasets import nyu_files
from netlib.errors import DataError


def test_depth_is_unpacked(tmp_path: Path) -> None:
    """Green counts units of 256 mm, blue 1 mm; red is ignored."""
    cv2.imwrite(str(tmp_path / "depth.png"), np.array([[[5, 3, 9], [0, 0, 0]]], dtype=np.uint8))
    np.testing.assert_array_equal(nyu_files.read_nyu_depth(tmp_path / "depth.png"), [[773, 0]])


def test_a_grey_image(tmp_path: Path) -> None:
    """A grey image raises an error, because the depth is in two channels of a colour image."""
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((2, 2), dtype=np.uint16))
    with pytest.raises(
        DataError, match=r"grey\.png: wrong size or type of image \(found uint16 of shape \(2, 2\), exp"
    ):
        nyu_files.read_nyu_depth(tmp_path / "grey.png")
