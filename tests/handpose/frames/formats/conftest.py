"""Stacks of frames in .npz files, for the tests of their arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from handpose.frames.formats.stack import StackRecording
from handpose.frames.recording import CameraInfo, Recording
from tests.handpose.frames.conftest import GIVEN, hand_sized

DEPTH = np.stack([hand_sized(distance=1000 + i) for i in range(4)])
SECONDS = np.array([0.0, 0.1, 0.2, 0.4])


def opened(folder: Path, given: CameraInfo = GIVEN, **others: Any) -> Recording:
    """The recording in an archive with these arrays."""
    np.savez(folder / "take.npz", **{"depth": DEPTH, **others})
    return StackRecording(folder / "take.npz", given)
