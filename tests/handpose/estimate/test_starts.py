"""handpose/estimate/starts.py"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from handpose.body.nyu import CENTER_JOINT, CUBE_MM
from handpose.body.sides import SIDES, mirror_of
from handpose.datasets.nyu_files import read_nyu_depth
from handpose.estimate import starts
from handpose.estimate.starts import PALM_MM, depth_around, find_hand, palm_frame, recenter
from handpose.frames.cameras import KINECT2, NYU
from handpose.synthetic import prior_file
from handpose.synthetic.generator import BLOCK, Generator
from handpose.synthetic.pose_prior import BodySampler
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter
from netlib.errors import DataError
from netlib.proto import prototxt, schema
from tests.handpose.whole_images import ARM_BEHIND, capsules_of, render_image
from tests.support.bad_input import bad_inputs
from tests.support.nyu_data_set import whole_image

EXACT = prior_file.load().but(
    center_jitter=0, center_jitter_wide=0, scale_std=0, bone_std=0
)  # all centres at one place of a palm
COUNT = 16


def whole_frames(camera, count=COUNT):
    """Depth images (N, height, width) in mm of hands in free space, and their crop centres (N, 3) in mm."""
    sampler, rng = BodySampler(), np.random.default_rng(7)
    hands = sampler.draw(rng, count)
    center = camera.unproject(sampler.centers(rng, count, camera))
    surface = capsules_of(sampler, rng, hands, center, ARM_BEHIND)
    return render_image(surface, camera), center


@pytest.fixture(scope="module")
def frames():
    """Frames of NYU's camera; pixels without a hand have infinite depth."""
    return whole_frames(NYU)


def distances(images, center, camera=NYU):
    """Distances (N,) in mm between the found and the true centres."""
    return np.linalg.norm([camera.unproject(find_hand(image, camera)) for image in images] - center, axis=1)


# ---------------------------------------------------------------------------------------------- find_hand


@pytest.mark.parametrize("camera", [NYU, KINECT2], ids=lambda camera: camera.name)
def test_the_hand_is_found(camera):
    """In whole images with arms the median error of the centre is below 40 mm, and 90% are below 60 mm."""
    median, most = np.percentile(distances(*whole_frames(camera, 96), camera), [50, 90])
    assert median < 40 and most < 60


def test_in_frames_of_nyus_format():
    """With sensor noise, and cut at the cube, the errors are close to those in the comment of the constants."""
    generator = Generator(seed=3)
    scenes = [generator.scene(number) for number in range(2)]
    images = [whole_image(scene, n) for scene in scenes for n in range(BLOCK)]
    centers = NYU.unproject(np.concatenate([scene.center_uvd for scene in scenes]))
    median, most = np.percentile(distances(images, centers), [50, 90])
    assert median < 33 and most < 58


def test_a_real_frame(nyu_data):
    """In NYU's first test frame the centre is within 50 mm of the annotated joint."""
    uvd = np.load(nyu_data / "test_joint_uvd.npz")["joint_uvd"][0, CENTER_JOINT]
    assert distances([read_nyu_depth(nyu_data / "depth_1_0000001.png")], NYU.unproject(uvd)) < 50


def test_what_is_behind_does_not_matter(frames):
    """A wall or a person behind the hand does not change the centre at all."""
    for image in frames[0][:4]:
        found = find_hand(image, NYU)
        hand = np.isfinite(image)
        body = np.zeros_like(hand)
        body[100:, 50:300] = True
        behind = np.where(body, image[hand].max() + 100, 2500)
        assert np.array_equal(find_hand(np.where(hand, image, behind), NYU), found)


def test_noise_in_front_does_not_matter(frames, rng):
    """Specks in front of the hand have too little surface to be one, for any number of pixels."""
    moved = []
    for image in frames[0]:
        noisy = image.copy()
        for row, column in zip(rng.integers(0, 460, 30), rng.integers(0, 620, 30)):
            noisy[row : row + 3, column : column + 3] = rng.uniform(200, 400)
        noisy[:40, :40] = 200  # 185 mm²
        found, without = (NYU.unproject(find_hand(each, NYU)) for each in (noisy, image))
        moved.append(np.linalg.norm(found - without))
    assert np.median(moved) < 1 and max(moved) < 25


@pytest.mark.parametrize("unread", [0, -1, np.nan, np.inf, -np.inf])
def test_pixels_without_a_reading(frames, unread):
    """Zero, negative, NaN and infinite depths are treated alike."""
    image = frames[0][0]
    assert np.array_equal(find_hand(np.where(np.isfinite(image), image, unread), NYU), find_hand(image, NYU))


def patch(side: int) -> np.ndarray:
    """An image of a square at 500 mm."""
    image = np.zeros((480, 640))
    image[100 : 100 + side, 100 : 100 + side] = 500
    return image


def stick(joints: str) -> Callable[[], object]:
    """A function that moves a crop for a skeleton of these joints."""
    body = Skeleton(schema.read(prototxt.parse(f'name: "stick" {joints}'), SkeletonParameter, "test"))
    return lambda: recenter(np.zeros((2, 3)), body, (320, 240, 700), CUBE_MM, NYU)


@bad_inputs(DataError, {
    **{f"all {unread}": (lambda unread=unread: find_hand(np.full((480, 640), unread), NYU),
                         "no depth anywhere in the image") for unread in (0, np.nan, np.inf)},
    "290 mm²": (lambda: find_hand(patch(20), NYU), "only 290 mm² of surface in the image, expected a hand"),
    "no depth around": (lambda: depth_around(np.zeros((80, 100)), 30, 50), "no depth around pixel 30, 50"),
    **{f"pixel {u}, {v}": (lambda u=u, v=v: depth_around(np.zeros((80, 100)), u, v),
                           f"pixel {u}, {v} lies outside the image of 100 x 80")
       for u, v in ((-1, 50), (99.6, 50), (50, 80))},
    "no palm": (stick('joint { name: "a" }'), "skeleton 'stick' has no joint 'palm' to move the crop to"),
    "one bone": (stick('joint { name: "palm" } joint { name: "a" parent: "palm" bone { axis: X length: 1 } }'),
                           "skeleton 'stick' has too few joints fixed to the palm to tell how it is turned"),
})
def test_where_no_hand_can_be(given, rejected):
    """An image without depth, or with less than a hand shows from any side, and a body without a palm are errors."""
    with rejected:
        given()


# ----------------------------------------------------------------------------------------------- recenter


@pytest.fixture(scope="module")
def hands():
    """Inputs (N, 47) of hands as in training crops, their crop centres (N, 3) in mm, and the sampler."""
    sampler, rng = BodySampler(prior=EXACT), np.random.default_rng(7)
    return sampler.draw(rng, COUNT).inputs, NYU.unproject(sampler.centers(rng, COUNT, NYU)), sampler


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


def test_of_a_huge_image_every_so_manieth_pixel_is_looked_at(frames, monkeypatch):
    """A very large image is subsampled, and the centre is the same to one pixel."""
    images, _ = frames
    larger = replace(NYU, fx=4 * NYU.fx, fy=4 * NYU.fy, u0=4 * NYU.u0, v0=4 * NYU.v0)
    monkeypatch.setattr(starts, "MAX_PIXELS", images[0].size)
    for image in images[:4]:
        found = find_hand(image.repeat(4, axis=0).repeat(4, axis=1), larger)
        assert np.abs(found / (4, 4, 1) - find_hand(image, NYU)).max() < 1
