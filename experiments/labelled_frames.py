"""Frames in which the places of hands are known: generated scenes, synthetic recordings, and real
recordings with labels.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.constants import joints_in
from handpose.frames.cameras import KINECT2, NYU, SR305, Camera
from handpose.frames.formats import open_recording
from handpose.sequences.recordings import SCRIPTS, SyntheticRecording
from handpose.synthetic.whole_scenes import SCENES_PER_BLOCK, SceneGenerator, Scenes
from handpose.tracking.track import PARTLY
from netlib.blob import Array
from netlib.errors import DataError

CAMERAS = (NYU, KINECT2, SR305)  # of synthetic recordings


class Labelled(NamedTuple):
    """A frame with its hands; those that may be found or not are ``doubtful``."""

    depth: Array
    camera: Camera
    hands: list[Array]
    doubtful: Sequence[Array] = ()


def first_scenes(generator: SceneGenerator, count: int) -> Iterator[tuple[Scenes, int]]:
    """The first scenes of a generator: the block of each, and its index in the block."""
    blocks = map(generator.block, itertools.count())
    scenes = ((block, n) for block in blocks for n in range(SCENES_PER_BLOCK))
    return itertools.islice(scenes, count)


def drawn_scenes(number: int, scenes: int) -> Iterator[Labelled]:
    """Scenes of the training's generator that no training saw."""
    for block, n in first_scenes(SceneGenerator(number, "test"), scenes):
        middle = block.middle[n]
        hands, doubtful = middle[block.present[n]], middle[block.doubtful[n]]
        yield Labelled(block.depth[n], camera_of(block, n), [*hands], [*doubtful])


def camera_of(scenes: Scenes, n: int) -> Camera:
    """The camera of a scene."""
    x = scenes.slopes[n, 0, :, 0].astype(float)
    y = scenes.slopes[n, :, 0, 1].astype(float)
    width, height = len(x), len(y)
    focal = (width - 1) / (x[-1] - x[0])
    return Camera("scene", focal, focal, -x[0] * focal, y[0] * focal, width, height, 60.0)


def other_scenes(number: int, scenes: int) -> Iterator[Labelled]:
    """One frame of each of ``scenes`` synthetic recordings, whose scripts, cameras and
    sides alternate.
    """
    scripts = list(SCRIPTS)
    for n in range(scenes):
        script, camera = scripts[n % len(scripts)], CAMERAS[n % len(CAMERAS)]
        mirrored = n // (len(scripts) * len(CAMERAS)) % 2 == 1
        recording = SyntheticRecording(script, camera, rate=1, seed=number + n, mirrored=mirrored)
        chosen = n % recording.count
        frame, truth = recording.frame(chosen), recording.truth(chosen)
        partly = [recording.movements[lost.id] for lost in truth.lost if lost.reason == PARTLY]
        hands = [hand.xyz.mean(0) for hand in truth.hands]
        doubtful = [movement.pose_at(frame.time).xyz.mean(0) for movement in partly]
        yield Labelled(frame.depth, recording.camera, hands, doubtful)


def recorded(source: str, labels: Sequence[str]) -> Iterator[Labelled]:
    """The frames of a recording, with the hands of one or several files of labels.

    Raises NetlibError.
    """
    if not labels:
        raise DataError(f"--recording {source}: no labels, expected LABELS.npy after the frames")
    joints = [joints_in(Path(name)) for name in labels]
    with open_recording(source) as recording:
        for frame in recording:
            hands = []
            for values in joints:
                points = values[frame.number : frame.number + 1].reshape(-1, 3)
                points = points[np.isfinite(points).all(axis=1)]
                if len(points):
                    hands.append(points.mean(0) * (1, -1, 1))
            yield Labelled(frame.depth, recording.camera, hands)
