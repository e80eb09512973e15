"""Frames, a camera and picture files of them, for all tests of recordings."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from handpose.frames.cameras import Camera
from handpose.frames.recording import CameraInfo, DepthFrame

CAMERA = Camera("own", 60.0, 61.0, 31.5, 23.5, 64, 48)
GIVEN = CameraInfo(CAMERA, unit_mm=0.5, rate=10.0, origin="--camera")


def hand_sized(shape: tuple[int, int] = (48, 64), distance: int = 1000) -> NDArray[np.uint16]:
    """An object of 10 x 12 px in front of a wall at twice the distance; at 500 mm it is 100 mm
    wide for CAMERA.
    """
    image = np.full(shape, 2 * distance, np.uint16)
    image[18:28, 26:38] = distance
    return image


def put(name: str | Path, image: NDArray[np.generic]) -> Path:
    """Write an image file."""
    path = Path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def middles(frames: Iterable[DepthFrame]) -> list[float]:
    """The depth of the object of ``hand_sized`` in each frame."""
    return [frame.depth[20, 30] for frame in frames]


def times_of(frames: Iterable[DepthFrame]) -> list[float]:
    return [frame.time for frame in frames]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Frames 1, 2 and 4, with the values 1001, 1002 and 1004 in the middle."""
    for number in (1, 2, 4):
        put(tmp_path / f"{number}.png", hand_sized(distance=1000 + number))
    return tmp_path
