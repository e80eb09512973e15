"""A short recording of a hand at rest on disk, and the file of its labels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from experiments.confidence_poses import true_labels
from handpose.frames import camera_file
from handpose.frames.cameras import ICVL
from handpose.frames.recording import CameraInfo
from handpose.sequences.acts import Act
from handpose.sequences.recordings import Script, SyntheticRecording


def write_labelled(
    folder: Path, frames: int = 4, unlabelled: Sequence[int] = ()
) -> tuple[Path, Path]:
    """The paths of the recording and of its labels (frames, 5, 4, 3), NaN for some frames."""
    recording = SyntheticRecording(
        Script(frames / 15, {"right": (Act("rest", 1),)}), ICVL, rate=15, seed=2
    )
    source, path = folder / "take", folder / "labels.npy"
    source.mkdir()
    for frame in recording:
        cv2.imwrite(str(source / f"{frame.number}.png"), frame.depth.astype(np.uint16))
    camera_file.write(source / "camera.json", CameraInfo(ICVL))
    labels = np.zeros((frames, 5, 4, 3))
    labels[:, :, 1:] = true_labels(recording) * (1, -1, 1)
    labels[list(unlabelled)] = np.nan
    np.save(path, labels)
    return source, path
