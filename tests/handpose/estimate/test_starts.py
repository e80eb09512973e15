"""handpose/estimate/starts.py"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from handpose.body.nyu import CUBE_MM
from handpose.body.sides import SIDES, mirror_of
from handpose.estimate.starts import PALM_MM, depth_around, palm_frame, recenter
from handpose.frames.cameras import NYU
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter
from netlib.errors import DataError
from netlib.proto import prototxt, schema
from tests.support.bad_input import bad_inputs

EXACT = prior_file.load().but(
    center_jitter=0, center_jitter_wide=0, scale_std=0, bone_std=0
)  # all centres at one place of a palm


def stick(joints: str) -> Callable[[], object]:
    """A function that moves a crop for a skeleton of these joints."""
    body = Skeleton(schema.read(prototxt.parse(f'name: "stick" {joints}'), SkeletonParameter, "test"))
    return lambda: recenter(np.zeros((2, 3)), body, (320, 240, 700), CUBE_MM, NYU)


@bad_inputs(DataError, {
    "no depth around": (lambda: depth_around(np.zeros((80, 100)), 30, 50), "no depth around pixel 30, 50"),
    **{f"pixel {u}, {v}": (lambda u=u, v=v: depth_around(np.zeros((80, 100)), u, v),
                           f"pixel {u}, {v} lies outside the image of 100 x 80")
       for u, v in ((-1, 50), (99.6, 50), (50, 80))},
    "no palm": (stick('joint { name: "a" }'), "skeleton 'stick' has no joint 'palm' to move the crop to"),
    "one bone": (stick('joint { name: "palm" } joint { name: "a" parent: "palm" bone { axis: X length: 1 } }'),
                           "skeleton 'stick' has too few joints fixed to the palm to tell how it is turned"),
})
def test_where_no_hand_can_be(given, rejected):
    """A place without depth, and a body without a palm, are errors."""
    with rejected:
        given()


# ----------------------------------------------------------------------------------------------- recenter


@pytest.fixture(scope="module")
def hands():
    """Inputs (N, 47) of hands as in training crops, their crop centres (N, 3) in mm, and the sampler."""
    sampler, rng = BodySampler(prior=EXACT), np.random.default_rng(7)
    return sampler.draw(rng, 16).inputs, NYU.unproject(sampler.centers(rng, 16, NYU)), sampler


def moved(inputs, sampler, by):
    """The joints (N, 31, 3) of the same hands, moved by ``by`` mm relative to the crop centre."""
    result = inputs.copy()
    for axis, distance in zip("xyz", by):
        result[:, sampler.skeleton.dof_names.index(f"palm_{axis}")] += distance / (CUBE_MM / 2)
    return sampler.kinematics.joints(result)


def test_a_crop_as_in_training_stays(hands):
    """The true joints of a correctly placed crop require no move."""
    inputs, centers, sampler = hands
    for joints, center in zip(sampler.kinematics.joints(inputs), centers):
        uvd = NYU.project(center)
        assert recenter(joints, sampler.skeleton, uvd, CUBE_MM, NYU) == pytest.approx(uvd, abs=1e-9)


@pytest.mark.parametrize("side", SIDES)
def test_a_crop_beside_moves_to_the_place_of_training(hands, side):
    """The centre moves by its error, also for a mirrored hand with mirrored joints."""
    inputs, centers, sampler = hands
    mirror = mirror_of(side)
    off = np.array([25.0, -40.0, 30.0])
    for joints, center in zip(moved(inputs, sampler, off * mirror), centers):
        found = recenter(joints, sampler.skeleton, NYU.project(center - off), CUBE_MM, NYU, side)
        assert NYU.unproject(found) == pytest.approx(center, abs=1e-9)


def test_how_the_palm_is_turned(hands):
    """The palm's rotation is computed from joint positions; with noise it is a rotation close to the true one."""
    inputs, _, sampler = hands
    pose = sampler.kinematics.forward(inputs)
    truth = sampler.kinematics.rotation_of(pose, sampler.skeleton.joint_names.index("palm"))
    rng = np.random.default_rng(0)
    for joints, frame in zip(pose.joints, truth):
        np.testing.assert_allclose(palm_frame(joints, sampler.skeleton), frame, atol=1e-12)
        near = palm_frame(joints + rng.normal(0, 0.01, joints.shape), sampler.skeleton)
        np.testing.assert_allclose(near.T @ near, np.eye(3), atol=1e-12)
        assert np.linalg.det(near) == pytest.approx(1) and np.abs(near - frame).max() < 0.15


# -------------------------------------------------------------------------------------------- depth_around


def test_the_median_depth_around_a_pixel():
    """The result is the median of readings within 8 pixels, plus half the thickness of a palm."""
    image = np.zeros((100, 100))
    image[40:61, 40:61] = 700
    image[50, 50:53] = (np.nan, np.inf, 200)
    assert depth_around(image, 50.4, 49.6) == pytest.approx([50.4, 49.6, 700 + PALM_MM])
    assert depth_around(image, 33, 50)[2] == 700 + PALM_MM, "8 pixels away"


def test_a_pixel_in_the_corner():
    """At the image border the neighbourhood is clipped."""
    image = np.full((100, 100), 900.0)
    image[:5, :5] = 0
    assert depth_around(image, 0, 0)[2] == depth_around(image, 99, 99)[2] == 900 + PALM_MM
