"""Synthetic depth frames of a body, usually a hand: training data without the NYU data set.

A frame is made in four steps, each described by one dataclass of numbers:

    PosePrior     poses: rotations, bent limbs, place, bone lengths (``prior_file``, ``pose_prior``)
    SurfacePrior  surfaces: thickness, limbs, sleeve (``surface_prior``); the capsules are the
                  skeleton file's
    render        the depth image, along the rays of the crop's pixels (``handpose.body.render``)
    Sensor        the errors of a depth camera (``sensor``)

A ``Recipe`` holds the numbers of all four; ``recipes`` has the named ones.

Labels are the skeleton's joints in half-cubes from the crop centre, camera axes
(x right, y up, z away), clipped to [-1, 1]; ``dof`` the inputs of the model that posed the frame;
``bones`` the signed bone lengths of the frame. With the skeleton file's bones instead, the inputs
give these joints only approximately (a hand: 4 mm on average).

Frames depend on the seed, the split and their number alone: each block of ``BLOCK`` frames has
its own random generator, so neither the number of worker processes nor the number of frames
changes a frame.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from handpose.body.render import normalise_depth, render_crop
from handpose.datasets.frames import Frames
from handpose.frames.cameras import NYU, Camera, Floats
from handpose.frames.crops import SIZE, window
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import Bodies, BodySampler, cut_normal
from handpose.synthetic.prior_parameters import PosePrior
from handpose.synthetic.scene_crops import draw_scene_crops
from handpose.synthetic.scenes.prior import ScenePrior
from handpose.synthetic.sensor import KINECT, Sensor, sense
from handpose.synthetic.surface_prior import DEFAULT_SURFACE, SurfacePrior, draw_capsules
from layers.hand.skeleton_file import text_of
from netlib.blob import Array

Split = Literal["train", "test"]

BLOCK = 64  # frames that share a random generator
# increase if the code (in this folder, or crops.py), not a number of a recipe, changes frames
VERSION = 6


class SyntheticCamera(NamedTuple):
    """A depth camera: its geometry, and its errors or None."""

    camera: Camera = NYU
    sensor: Sensor | None = KINECT


@dataclass(frozen=True)
class Subject:
    """Another person than the skeleton file's, always the same."""

    cube_mm: float  # edge of the crops: smaller for a smaller person
    bone_std: float  # normal: deviation of each bone, in addition to the size
    seed: int  # of these deviations


@dataclass(frozen=True)
class Recipe:
    """All numbers that frames depend on, except for the seed.

    flesh   of the surfaces; the name is that in the data's files
    views   cameras, of which each block of frames has one at random
    others  people in the test split only, in turn with the skeleton file's
    around  what is around the hands of every second block, whose frames have the errors of whole
            scenes; None: all hands are alone
    """

    prior: PosePrior = field(default_factory=prior_file.load)
    flesh: SurfacePrior = DEFAULT_SURFACE
    views: tuple[SyntheticCamera, ...] = (SyntheticCamera(),)
    others: tuple[Subject, ...] = ()
    around: ScenePrior | None = None


class Scene(NamedTuple):
    """A block of frames, before anything is clipped to the cube."""

    bodies: Bodies  # half-cubes from the crop centres
    center_uvd: Array  # (BLOCK, 3) crop centres: px, px, mm
    depth: Floats  # (BLOCK, 128, 128) crops in [-1, 1]
    camera: Camera
    cube_mm: float  # edge of the crops


def rng_of(seed: int, split: Split, *block: int) -> np.random.Generator:
    """The random generator of a block, which depends on nothing else; seeds are less than 2^32."""
    entropy = np.random.SeedSequence([seed, get_args(Split).index(split), *block])
    return np.random.Generator(np.random.SFC64(entropy))


class Generator:
    """Draws frames, in blocks of ``BLOCK`` frames by number, for a seed and a split."""

    description = (
        "Rendered capsules with a depth camera's noise; crops 128 x 128 in [-1, 1], joints in half-cubes from the crop "
        "centre (camera axes, x right, y up, z away), dof and bones: what posed the skeleton; other lengths in mm."
    )

    def __init__(self, seed: int = 0, split: Split = "train", recipe: Recipe | None = None) -> None:
        self.seed, self.split, self.recipe = seed, split, recipe or Recipe()
        self.sampler = BodySampler(self.recipe.prior)
        others = self.recipe.others if split == "test" else ()
        self._samplers = [self.sampler, *map(self._sampler_of, others)]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments only; a worker process builds its own tables."""
        return type(self), (self.seed, self.split, self.recipe)

    def block(self, number: int) -> Frames:
        """Frames ``number * BLOCK`` and following; the result depends on the number only."""
        scene = self.scene(number)
        bodies = scene.bodies
        posers = {}
        if not self.recipe.around:  # the roots of hands in scenes have no inputs
            own = len(self.sampler.skeleton.joint_names)
            posers = {"dof": bodies.inputs, "bones": bodies.bones[:, :own]}
        return Frames.of(
            crops=scene.depth,
            joints=bodies.joints,
            center_uvd=scene.center_uvd,
            camera=scene.camera,
            half_cube=scene.cube_mm / 2,
            index=np.arange(number * BLOCK, (number + 1) * BLOCK),
            **posers,
        )

    def scene(self, number: int) -> Scene:
        """The bodies, crops and labels of a block."""
        rng = rng_of(self.seed, self.split, number)
        sampler = self._samplers[number % len(self._samplers)]
        cube_mm = sampler.cube_mm
        half = cube_mm / 2
        camera, sensor = self.recipe.views[rng.integers(len(self.recipe.views))]
        if self.recipe.around and number % 2:
            drawn = draw_scene_crops(rng, self.recipe.around, sampler, camera, BLOCK)
            return Scene(*drawn, camera, cube_mm)
        bodies = sampler.draw(rng, BLOCK)
        center_uvd = sampler.centers(rng, BLOCK, camera)
        center = camera.unproject(center_uvd)
        z = center_uvd[:, 2]
        capsules = draw_capsules(rng, self.recipe.flesh, sampler.surface, bodies, half, center)
        depth = render_crop(capsules, center_uvd, cube_mm, camera)
        if sensor is not None:
            pixel = SIZE * z / (cube_mm * camera.fx)
            depth = sense(rng, depth, z + half, sensor, camera, pixel)
            _blank_outside(depth, center_uvd, camera, cube_mm)
        return Scene(bodies, center_uvd, normalise_depth(depth, z, cube_mm), camera, cube_mm)

    def made_from(self, *rows: int) -> dict[str, object]:
        """Everything that the frames depend on, as JSON values; the same for all ``rows``."""
        views = [
            [asdict(part) if part else None for part in view]  # camera and sensor
            for view in self.recipe.views
        ]
        recipe = asdict(self.recipe) | {"views": views}
        around = recipe.pop("around")
        if around:  # recipes without it are those of data that were made before it existed
            recipe["around"] = _digest(json.dumps(around))
        skeleton = self.sampler.skeleton
        body = _digest(text_of(skeleton.param, skeleton.name, ""))
        return {"version": VERSION, "seed": self.seed, "split": self.split, "body": body, **recipe}

    def _sampler_of(self, subject: Subject) -> BodySampler:
        prior, skeleton = self.recipe.prior, self.sampler.skeleton
        rng = np.random.Generator(np.random.SFC64(subject.seed))
        bones = skeleton.bones
        factors = cut_normal(rng, 1, subject.bone_std, bones.shape, prior.scale_clip)
        own = skeleton.with_numbers(skeleton.param.dof, bones * factors)
        return BodySampler(prior, subject.cube_mm, own)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _blank_outside(depth: Floats, center_uvd: Array, camera: Camera, cube_mm: float) -> None:
    """Make crop pixels without an image pixel background again, after ragged edges moved there."""
    pixels = window(center_uvd, cube_mm, camera)
    columns = pixels.columns < 0
    rows = pixels.rows < 0
    for n in np.flatnonzero(columns.any(axis=1) | rows.any(axis=1)):
        far = center_uvd[n, 2] + cube_mm / 2
        depth[n][:, columns[n]] = far
        depth[n][rows[n]] = far
