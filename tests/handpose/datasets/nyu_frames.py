"""Frames and labels in NYU's format, as the data set has them, for tests."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from handpose.datasets import nyu_files
from handpose.frames.cameras import NYU
from tests.support.nyu_data_set import pack_depth, write_annotation


def hand(count: int) -> np.ndarray:
    """Annotated joints (count, 36, 3) in px and mm at the image centre, 800 mm away."""
    return np.tile([320.0, 240.0, 800.0], (count, 36, 1)) + np.random.default_rng(0).normal(0, 5, (count, 36, 3))


def write_labels(folder: Path, uvd: np.ndarray) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_annotation(folder / nyu_files.ANNOTATION, NYU.unproject(uvd))


def write_frame(path: Path, depth: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pack_depth(depth))
