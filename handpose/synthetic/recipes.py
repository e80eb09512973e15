"""Named recipes: hands, their poses and their cameras; and recipes of other bodies."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from handpose.body.nyu import CUBE_MM
from handpose.frames.cameras import CAMERAS, ICVL, KINECT2, NYU, SR305
from handpose.synthetic import prior_file
from handpose.synthetic.generator import Generator, Recipe, Subject, SyntheticCamera
from handpose.synthetic.prior_parameters import PosePrior, RangeParameter
from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.sensor import CODED_LIGHT, KINECT, NOISY_KINECT, TIME_OF_FLIGHT, sensor_of
from handpose.synthetic.surface_prior import PERSON_SURFACE, SurfacePrior
from netlib.errors import NetlibError

MAX_OUT_OF_VIEW = 0.5  # share of joints, and of frames
ONE_THICKNESS = SurfacePrior(thickness_std=0.0)
# like NYU's second subject: smaller, with other proportions
SECOND_SUBJECT = Subject(cube_mm=261.0, bone_std=0.04, seed=2)
# Hands of all ages, seen from all sides; the surface of their skeleton has the median thickness. An
# arm may come from the camera's side.
PEOPLE_SURFACE = SurfacePrior(
    thickness_std=0.1,
    trunk_std=0.08,
    radius_std=0.06,
    offsets=(0.4, 1.6),
    limb=(0.75, 1.2),
    towards_camera=0.7,
    cut=0.3,
    sleeve=0.4,
)


def any_roll() -> PosePrior:
    """Hands in front of any camera: every roll, so that hands pointing down are as common as
    others, near and far.
    """
    turned = prior_file.load().turned("palm_rot_z", any=0.6).turned("palm_rot_x", std=36.0)
    depth = RangeParameter(250.0, 1200.0)
    return turned.but(depth=depth, center_jitter=4.0, center_jitter_wide=10.0)


def like_nyu() -> PosePrior:
    """Hands as NYU shows them: most are between two gestures, and palms are turned as those of
    its test frames.

    There half of the palms are turned by at most 46 degrees from the median one, a quarter by more
    than 79, a tenth by more than 125 (of the hand fitted to the annotation); here it is 49, 71 and
    118. The prior file's are turned more.
    """
    turned = (
        prior_file.load()
        .turned("palm_rot_z", mean=30.0, std=28.0, any=0.1)
        .turned("palm_rot_x", mean=-15.0, std=20.0)
        .turned("palm_rot_y", mean=-14.0, std=34.0, any=0.2)
    )
    return turned.but(blend=0.75)


def _people() -> Recipe:
    kinect = replace(KINECT, spread=(0.0, 1.5))
    noisy = replace(NOISY_KINECT, spread=(0.0, 2.0))
    time_of_flight = replace(
        TIME_OF_FLIGHT, spread=(0.0, 3.0), depth_noise=(0.5, 3.0), dropout=(0.0, 0.9)
    )
    coded_light = replace(CODED_LIGHT, spread=(0.0, 2.0), disparity_noise=(0.0, 0.08))
    views = (
        SyntheticCamera(NYU, kinect),
        SyntheticCamera(NYU, noisy),
        SyntheticCamera(KINECT2, time_of_flight),
        SyntheticCamera(SR305, coded_light),
        SyntheticCamera(ICVL, time_of_flight),
        SyntheticCamera(ICVL, coded_light),
    )
    return Recipe(prior_file.load(prior_file.PEOPLE_PRIOR), PEOPLE_SURFACE, views)


def _in_scenes() -> Recipe:
    people = _people()
    # a finder's places are less exact than a network's
    prior = people.prior.but(center_jitter=10.0, center_jitter_wide=25.0, wide=0.4)
    return replace(people, prior=prior, around=scene_prior.load())


def _cameras() -> Recipe:
    views = (
        SyntheticCamera(),
        SyntheticCamera(NYU, NOISY_KINECT),
        SyntheticCamera(KINECT2, TIME_OF_FLIGHT),
        SyntheticCamera(SR305, CODED_LIGHT),
        SyntheticCamera(ICVL, TIME_OF_FLIGHT),
    )
    return Recipe(any_roll(), PERSON_SURFACE, views)


_RECIPES: dict[str, Callable[[], Recipe]] = {
    "nyu": Recipe,  # NYU's camera, distances and poses
    "any_roll": lambda: Recipe(any_roll()),
    "cameras": _cameras,  # any person, any camera
    "people": _people,  # adults and children, seen from any side
    "in_scenes": _in_scenes,  # half of them alone, half in whole scenes
    "one_hand": lambda: Recipe(
        like_nyu().but(scale_std=0.0, bone_std=0.0), ONE_THICKNESS, others=(SECOND_SUBJECT,)
    ),
    "many_hands": lambda: Recipe(like_nyu()),
}
NAMES = tuple(_RECIPES)


@functools.cache
def recipe(name: str) -> Recipe:
    """The recipe of ``NAMES`` with this name. Raises PrototxtError for an invalid prior file."""
    return _RECIPES[name]()


def recipe_of(prior: str | Path) -> Recipe:
    """A body of a prior file, seen by the camera that the file names.

    Raises PrototxtError, NetlibError.
    """
    loaded = prior_file.load(prior)
    camera = CAMERAS[loaded.camera]
    sensor = sensor_of(camera)
    # an edge is a steep slope between pixels, which lie farther apart in crops of a larger body
    steep = replace(sensor, edge=sensor.edge * max(loaded.cube_mm / CUBE_MM, 1))
    return Recipe(loaded, views=(SyntheticCamera(camera, steep),))


def check_in_view(recipe: Recipe, seed: int) -> None:
    """Raise NetlibError if most of a body is outside the crops, as when lengths are in mm instead
    of half-cubes.
    """
    frames = Generator(seed, "train", recipe).block(0)
    outside = float((np.abs(frames.joint) >= 1).mean())  # the labels are clipped
    empty = float((np.ptp(frames.depth, axis=(1, 2, 3)) == 0).mean())
    if max(outside, empty) > MAX_OUT_OF_VIEW:
        prior = recipe.prior
        shown = f"{outside:.0%} of the joints lie outside the crops, {empty:.0%} of the frames show nothing"
        raise NetlibError(
            f"skeleton {prior.skeleton}: {shown}; expected lengths in half-cubes, {prior.cube_mm / 2:g} mm, and a "
            f"cube_mm, center, depth and lateral_x, lateral_y that bring the body into view"
        )
