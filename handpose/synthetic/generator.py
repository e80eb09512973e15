"""Synthetic depth frames of hands: training data for those who do not have NYU.

A frame is made in four steps, each described by one dataclass of numbers:

    PosePrior    how hands are held: rotations, curled fingers, place, bone lengths (``pose_prior``)
    FleshPrior   whose flesh it is: thickness, forearm, sleeve (``flesh_prior``); the capsules are the skeleton file's
    render       the depth image, along the rays that the NYU crop picks (``handpose.flesh.render``)
    Sensor       what a depth camera makes of it (``sensor``)

A ``Recipe`` holds the numbers of all four; ``RECIPES`` has those with a name.

Labels are those of NYU: 31 joints in half-cubes from the crop centre, camera axes (x right, y up, z away),
clipped to [-1, 1]. They belong to the frame's own bones. ``dof`` holds the model's 47 inputs that posed the
frame; with the packaged bones instead of the frame's own they give these joints only nearly (4 mm on the mean).

Frames depend on the seed, the split and their number alone: each block of ``BLOCK`` frames has a random
generator of its own, so neither the number of worker processes nor the number of frames changes a frame.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from handpose.data.crops import window
from handpose.data.frames import Frames, empty_frames
from handpose.facts.cameras import ICVL, KINECT2, NYU, SR305, Camera
from handpose.facts.nyu import CUBE_MM
from handpose.flesh.render import Floats, normalise_depth, render_crop
from handpose.synthetic.flesh_prior import ANYBODY, DEFAULT_FLESH, OTHER_FLESH, FleshPrior, draw_capsules
from handpose.synthetic.pose_prior import ANY_ROLL, DEFAULT_PRIOR, Hands, HandSampler, PosePrior
from handpose.synthetic.sensor import CODED_LIGHT, KINECT, NOISY_KINECT, TIME_OF_FLIGHT, Sensor, sense
from layers.hand.skeleton_file import text_of
from netlib.blob import Array
from netlib.errors import DataError

Split = Literal["train", "test"]

BLOCK = 64  # frames that share a random generator
VERSION = 4  # to be raised when the code (in this folder, or crops.py), not a number of a recipe, changes frames


class View(NamedTuple):
    """A depth camera: its geometry and its faults, or none."""

    camera: Camera = NYU
    sensor: Sensor | None = KINECT


@dataclass(frozen=True)
class Recipe:
    """All numbers that frames depend on, beside the seed. A block of frames is seen by one of the views."""

    prior: PosePrior = DEFAULT_PRIOR
    flesh: FleshPrior = DEFAULT_FLESH
    views: tuple[View, ...] = (View(),)
    cube_mm: float = CUBE_MM


RECIPES = {
    "nyu": Recipe(),  # NYU's camera, distances and poses
    "other_flesh": Recipe(flesh=OTHER_FLESH, views=(View(NYU, NOISY_KINECT),)),  # to test on: hands that no fit knows
    "any_roll": Recipe(prior=ANY_ROLL),  # ... and hands turned by any angle
    "cameras": Recipe(  # anybody before any camera
        ANY_ROLL,
        ANYBODY,
        (View(), View(NYU, NOISY_KINECT), View(KINECT2, TIME_OF_FLIGHT), View(SR305, CODED_LIGHT),
         View(ICVL, TIME_OF_FLIGHT)),
    ),
}  # fmt: skip


class Scene(NamedTuple):
    """What a block of frames shows, before anything is clipped to the cube."""

    hands: Hands  # half-cubes from the crop centres
    camera: Camera
    center_uvd: Array  # (BLOCK, 3) crop centres: px, px, mm
    depth: Floats  # (BLOCK, 128, 128) crops in [-1, 1]


def check_source(seed: int, split: str) -> None:
    """Raise DataError for a seed or a split that there is not."""
    if seed < 0:
        raise DataError(f"seed {seed}, expected 0 or more")
    if split not in get_args(Split):
        raise DataError(f"split {split!r}, expected one of {', '.join(get_args(Split))}")


def numbers_of(seed: int, split: Split, *block: int) -> np.random.Generator:
    """The random numbers of a block, which depend on nothing else."""
    source = np.random.SeedSequence([seed, get_args(Split).index(split), *block])
    return np.random.Generator(np.random.SFC64(source))


class Generator:
    """Draws frames. Build one for a seed and split, then ask for blocks of ``BLOCK`` frames by number."""

    description = (
        "Rendered capsule hands with a depth camera's noise; crops 128 x 128 in [-1, 1], joints in half-cubes from the "
        "crop centre (camera axes, x right, y up, z away), dof: the hand model's inputs; lengths in mm."
    )

    def __init__(self, seed: int = 0, split: Split = "train", recipe: Recipe = RECIPES["nyu"]) -> None:
        check_source(seed, split)
        self.seed, self.split, self.recipe = seed, split, recipe
        self.sampler = HandSampler(recipe.prior, recipe.cube_mm)

    def __reduce__(self) -> tuple[Any, ...]:
        """A worker process gets the numbers, and makes its own tables of them."""
        return type(self), (self.seed, self.split, self.recipe)

    def block(self, number: int) -> Frames:
        """Frames ``number * BLOCK`` and following. The same numbers whenever and wherever they are asked for."""
        scene = self.scene(number)
        index = np.arange(number * BLOCK, (number + 1) * BLOCK)
        return Frames.of(scene.depth, scene.hands.joints, scene.center_uvd, scene.camera, self.recipe.cube_mm / 2,
                         index, scene.hands.inputs)  # fmt: skip

    def scene(self, number: int) -> Scene:
        """What the frames of a block are made of."""
        rng = numbers_of(self.seed, self.split, number)
        r, half = self.recipe, self.recipe.cube_mm / 2
        camera, sensor = r.views[int(rng.integers(len(r.views)))]
        hands = self.sampler.hands(rng, BLOCK)
        center_uvd = self.sampler.centers(rng, BLOCK, camera)
        center = camera.unproject(center_uvd)
        capsules = draw_capsules(rng, r.flesh, self.sampler.flesh, hands.inputs, hands.bones, hands.scale, half, center)
        depth = render_crop(capsules, center_uvd, r.cube_mm, camera)
        if sensor is not None:
            depth = sense(rng, depth, center_uvd[:, 2] + half, sensor, camera)
            self._blank_outside(depth, center_uvd, camera)
        return Scene(hands, camera, center_uvd, normalise_depth(depth, center_uvd[:, 2], r.cube_mm))

    def columns(self) -> dict[str, Array]:
        """Arrays without rows, of the shapes and types of the frames'."""
        skeleton = self.sampler.skeleton
        return empty_frames(len(skeleton.joint_names), len(skeleton.dof_names)).arrays()

    def made_from(self) -> dict[str, object]:
        """All that the frames depend on, in plain values that JSON can hold."""
        recipe = asdict(self.recipe) | {
            "views": [[asdict(part) if part else None for part in v] for v in self.recipe.views]
        }
        body = text_of(self.sampler.skeleton.param, self.sampler.skeleton.name, "")
        return {
            "version": VERSION,
            "seed": self.seed,
            "split": self.split,
            "body": hashlib.sha256(body.encode()).hexdigest()[:16],
            **recipe,
        }

    def _blank_outside(self, depth: Floats, center_uvd: Array, camera: Camera) -> None:
        """Crop pixels that no image pixel fills are background again, whatever ragged edges moved there."""
        picked = window(center_uvd, self.recipe.cube_mm, camera)
        columns, rows = picked.columns < 0, picked.rows < 0
        for n in np.flatnonzero(columns.any(axis=1) | rows.any(axis=1)):
            far = center_uvd[n, 2] + self.recipe.cube_mm / 2
            depth[n][:, columns[n]] = far
            depth[n][rows[n]] = far
