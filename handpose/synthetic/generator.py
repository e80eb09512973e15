"""Synthetic depth frames of hands: training data for those who do not have NYU.

A frame is made in four steps, each described by one dataclass of numbers:

    PosePrior    how hands are held: rotations, curled fingers, place, bone lengths (``pose_prior``)
    HandShape    flesh: capsules along the bones, a palm on its own side of them, a forearm (``flesh``)
    render       the depth image, along the rays that the NYU crop picks (``render``)
    Sensor       what a Kinect makes of it (``sensor``)

Labels are those of NYU: 31 joints in half-cubes from the crop centre, camera axes (x right, y up, z away),
clipped to [-1, 1]. They belong to the frame's own bones. ``dof`` holds the model's 47 inputs that posed the
frame; with the packaged bones instead of the frame's own they give these joints only nearly (4 mm on the mean).

Frames depend on the seed, the split and their number alone: each block of ``BLOCK`` frames has a random
generator of its own, so neither the number of worker processes nor the number of frames changes a frame.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from handpose.data.crops import window
from handpose.data.frames import Frames, empty_frames
from handpose.facts.cameras import NYU, Camera
from handpose.facts.nyu import CUBE_MM
from handpose.synthetic.flesh import DEFAULT_SHAPE, HandShape
from handpose.synthetic.pose_prior import DEFAULT_PRIOR, Hands, HandSampler, PosePrior
from handpose.synthetic.render import Floats, normalise_depth, render_crop
from handpose.synthetic.sensor import KINECT, Sensor, sense
from netlib.blob import Array
from netlib.errors import DataError

Split = Literal["train", "test"]

BLOCK = 64  # frames that share a random generator
VERSION = 3  # to be raised when the code (in this folder, or crops.py), not a number of a recipe, changes frames


class Scene(NamedTuple):
    """What a block of frames shows, before anything is clipped to the cube."""

    hands: Hands  # half-cubes from the crop centres
    center_uvd: Array  # (BLOCK, 3) crop centres: px, px, mm
    depth: Floats  # (BLOCK, 128, 128) crops in [-1, 1]


class Generator:
    """Draws frames. Build one for a seed and split, then ask for blocks of ``BLOCK`` frames by number."""

    def __init__(
        self,
        seed: int = 0,
        split: Split = "train",
        prior: PosePrior = DEFAULT_PRIOR,
        shape: HandShape = DEFAULT_SHAPE,
        sensor: Sensor | None = KINECT,
        camera: Camera = NYU,
        cube_mm: float = CUBE_MM,
    ) -> None:
        if seed < 0:
            raise DataError(f"seed {seed}, expected 0 or more")
        if split not in get_args(Split):
            raise DataError(f"split {split!r}, expected one of {', '.join(get_args(Split))}")
        self.seed, self.split, self.camera, self.cube_mm = seed, split, camera, cube_mm
        self.prior, self.shape, self.sensor = prior, shape, sensor
        self.sampler = HandSampler(prior, shape, cube_mm)

    def __reduce__(self) -> tuple[Any, ...]:
        """A worker process gets the numbers, and makes its own tables of them."""
        options = (self.seed, self.split, self.prior, self.shape, self.sensor, self.camera, self.cube_mm)
        return type(self), options

    def block(self, number: int) -> Frames:
        """Frames ``number * BLOCK`` and following. The same numbers whenever and wherever they are asked for."""
        scene = self.scene(number)
        index = np.arange(number * BLOCK, (number + 1) * BLOCK)
        return Frames.of(scene.depth, scene.hands.joints, scene.center_uvd, self.camera, self.cube_mm / 2, index,
                         scene.hands.inputs)  # fmt: skip

    def scene(self, number: int) -> Scene:
        """What the frames of a block are made of."""
        source = np.random.SeedSequence([self.seed, get_args(Split).index(self.split), number])
        rng = np.random.Generator(np.random.SFC64(source))
        hands = self.sampler.hands(rng, BLOCK)
        center_uvd = self.sampler.centers(rng, BLOCK, self.camera)
        half = self.cube_mm / 2
        joints = hands.joints * half + self.camera.unproject(center_uvd)[:, None]
        capsules = self.sampler.flesh.capsules(rng, joints, hands.scale)
        depth = render_crop(capsules, center_uvd, self.cube_mm, self.camera)
        if self.sensor is not None:
            depth = sense(rng, depth, center_uvd[:, 2] + half, self.sensor, self.camera)
            self._blank_outside(depth, center_uvd)
        return Scene(hands, center_uvd, normalise_depth(depth, center_uvd[:, 2], self.cube_mm))

    def columns(self) -> dict[str, Array]:
        """Arrays without rows, of the shapes and types of the frames'."""
        skeleton = self.sampler.skeleton
        return empty_frames(len(skeleton.joint_names), len(skeleton.dof_names)).arrays()

    def recipe(self) -> dict[str, object]:
        """All that the frames depend on, in plain values that JSON can hold."""
        return {
            "version": VERSION,
            "seed": self.seed,
            "split": self.split,
            "camera": asdict(self.camera),
            "cube_mm": self.cube_mm,
            "skeleton": self.sampler.skeleton.name,
            "prior": asdict(self.prior),
            "shape": asdict(self.shape),
            "sensor": asdict(self.sensor) if self.sensor else None,
        }

    def _blank_outside(self, depth: Floats, center_uvd: Array) -> None:
        """Crop pixels that no image pixel fills are background again, whatever ragged edges moved there."""
        picked = window(center_uvd, self.cube_mm, self.camera)
        columns, rows = picked.columns < 0, picked.rows < 0
        for n in np.flatnonzero(columns.any(axis=1) | rows.any(axis=1)):
            far = center_uvd[n, 2] + self.cube_mm / 2
            depth[n][:, columns[n]] = far
            depth[n][rows[n]] = far
