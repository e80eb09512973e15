"""handpose/synthetic.py"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from handpose.camera import NYU
from handpose.crop import crop, crop_pixels, restore_joints, window
from handpose.nyu import ANNOTATION_OF_JOINT, CENTER_JOINT
from handpose.render import Capsules, normalise_depth, render_crop, render_image
from handpose.synthetic import BLOCK, Frames, Generator, HandShape, PosePrior, empty_frames, generate
from netlib.errors import DataError


@pytest.fixture(scope="module")
def generator() -> Generator:
    """The default generator."""
    return Generator(seed=7)


@pytest.fixture(scope="module")
def frames(generator: Generator) -> Frames:
    """Its first block."""
    return generator.block(0)


def assert_equal(one: Frames, two: Frames) -> None:
    """Every array is the same."""
    for name, array in one.arrays().items():
        np.testing.assert_array_equal(array, two.arrays()[name], name)


def test_arrays(frames: Frames) -> None:
    """Frames have the documented shapes, types and ranges."""
    shapes = [(BLOCK, 1, 128, 128), (BLOCK, 93), (BLOCK, 47), (BLOCK, 3), (BLOCK, 3), (BLOCK,), (BLOCK,)]
    arrays = list(frames.arrays().values())
    assert [array.shape for array in arrays] == shapes
    assert [array.dtype for array in arrays] == [np.float32] * 5 + [np.int64, np.float32]
    for array, empty in zip(arrays, empty_frames().arrays().values(), strict=True):
        assert (array.shape[1:], array.dtype) == (empty.shape[1:], empty.dtype) and len(empty) == 0
    for array in (frames.depth, frames.joint):
        assert array.min() >= -1 and array.max() == 1
    assert all(np.isfinite(array).all() for array in arrays)
    np.testing.assert_array_equal(frames.index, np.arange(BLOCK))


def test_frames_depend_on_seed_split_and_number_only(generator: Generator, frames: Frames) -> None:
    """The same generator repeats itself whatever it drew before; another seed, split or block is different."""
    generator.block(3)
    assert_equal(generator.block(0), frames)
    for other in (Generator(8).block(0), Generator(7, "test").block(0), generator.block(1)):
        assert (np.abs(other.joint - frames.joint).max(axis=1) > 0.05).all()


def test_generate_cuts_anywhere(generator: Generator, frames: Frames) -> None:
    """Frames of any stretch, over block borders, are those of the blocks."""
    pieces = list(generate(BLOCK, generator, start=BLOCK // 2))
    assert [len(piece) for piece in pieces] == [BLOCK // 2, BLOCK // 2]
    np.testing.assert_array_equal(pieces[0].depth, frames.depth[BLOCK // 2 :])
    np.testing.assert_array_equal(np.concatenate([p.index for p in pieces]), np.arange(BLOCK // 2, BLOCK * 3 // 2))
    (few,) = generate(3, generator)
    np.testing.assert_array_equal(few.joint, frames.joint[:3])
    assert not list(generate(0, generator))


def test_workers_change_nothing(generator: Generator) -> None:
    """Two processes draw the same frames in the same order as one."""
    count = 3 * BLOCK + 5
    for one, two in zip(generate(count, generator), generate(count, generator, workers=2), strict=True):
        assert_equal(one, two)


def test_bones_vary_within_reason(generator: Generator) -> None:
    """Joints are apart by their frame's bones, which are the skeleton's times a hand's and a bone's own factor."""
    hands = generator.hands(np.random.default_rng(0), 500)
    skeleton = generator.skeleton
    child = np.flatnonzero(skeleton.parents >= 0)
    lengths = np.linalg.norm(hands.joints[:, child] - hands.joints[:, skeleton.parents[child]], axis=2)
    np.testing.assert_allclose(lengths, np.abs(hands.bones[:, child]), atol=1e-12)
    own = lengths / np.abs(skeleton.bones[child]) / hands.scale[:, None]
    assert own.std() == pytest.approx(0.04, rel=0.1)
    assert hands.scale.std() == pytest.approx(0.06, rel=0.15)
    assert np.abs(own - 1).max() <= 0.1 + 1e-9 and np.abs(hands.scale - 1).max() <= 0.15 + 1e-9


def test_parameters_are_the_models(generator: Generator) -> None:
    """``dof`` is within the limits, 0 where fixed, and poses the packaged hand within a few mm of the labels."""
    hands = generator.hands(np.random.default_rng(0), 500)
    skeleton = generator.skeleton
    assert (hands.inputs >= skeleton.lower - 1e-12).all() and (hands.inputs <= skeleton.upper + 1e-12).all()
    assert (hands.inputs[:, skeleton.fixed] == 0).all()
    np.testing.assert_allclose(skeleton.joints(hands.inputs, hands.bones), hands.joints, atol=1e-12)
    nearly = np.linalg.norm(skeleton.joints(hands.inputs) - hands.joints, axis=2) * 150
    assert 1 < nearly.mean() < 6


def test_fingers_rarely_run_through_each_other(generator: Generator) -> None:
    """Hardly a hand has parts deeper in each other than the prior allows."""
    hands = generator.hands(np.random.default_rng(0), 500)
    assert (generator._penetration(hands.joints * 150, hands.scale) > PosePrior().penetration + 1).mean() < 0.01


def test_center_is_in_the_palm(generator: Generator) -> None:
    """The crop centre lies as far from the palm joint as NYU's joint 34, give or take the jitter."""
    hands = generator.hands(np.random.default_rng(0), 500)
    distance = np.linalg.norm(hands.joints[:, generator.skeleton.joint_names.index("palm")], axis=1) * 150
    assert np.median(distance) == pytest.approx(np.linalg.norm(PosePrior().center_in_palm), abs=2)
    assert distance.max() < 70


def test_joints_are_inside_the_flesh() -> None:
    """Along the ray through a joint the surface is in front of it; mostly no more than a finger or palm in front."""
    frames = Generator(seed=3, sensor=None).block(0)
    joints = frames.joint.reshape(-1, 31, 3).astype(float)
    xyz = restore_joints(joints, frames.center, frames.half_cube)
    at = np.rint(crop_pixels(NYU.project(xyz), frames.center_uvd, 300.0)).astype(int)
    n, k = np.nonzero(((at >= 0) & (at < 128)).all(axis=2) & (np.abs(joints) < 0.99).all(axis=2))
    assert len(n) > 1800
    surface = frames.depth[n, 0, at[n, k, 1], at[n, k, 0]]
    gap = (joints[n, k, 2] - surface) * 150
    assert (gap > -1).all()
    assert np.median(gap) == pytest.approx(12, abs=6)


def test_flesh_lies_towards_the_palm(generator: Generator) -> None:
    """A hand seen from its palm has more before its wrist than one seen from its back; its joints are the same."""
    skeleton = generator.skeleton
    inputs = np.stack([-skeleton.initial, -skeleton.initial])
    inputs[1, skeleton.dof_names.index("palm_rot_y")] += np.pi
    joints = skeleton.joints(inputs) * 150 + (0, 0, 800)
    flesh = generator.flesh(np.random.default_rng(0), joints, np.ones(2))
    hand = Capsules(*(values[:, :-1] for values in flesh))  # a forearm would hide the wrist
    at = NYU.project(joints)
    for joint, least, most in (("wrist_middle", 14, 24), ("ring_mcp", 8, 18), ("ring_tip", -3, 3)):
        k = skeleton.joint_names.index(joint)
        palm, back = (
            joints[n, k, 2] - image[round(at[n, k, 1]), round(at[n, k, 0])]
            for n, image in enumerate(render_image(hand, NYU))
        )
        assert least < palm - back < most
    wrist = joints[:, generator._wrist].mean(axis=1)
    back_of_hand = generator._palm_axes(joints)[2]
    shift = ((flesh.a[:, -1] - wrist) * back_of_hand).sum(axis=1)
    np.testing.assert_allclose(shift, -HandShape().forearm_towards_palm)


def test_rendered_hand_equals_its_cropped_image(generator: Generator) -> None:
    """A hand drawn along the crop's rays is the crop of the hand drawn on the whole image."""
    rng = np.random.default_rng(5)
    hands = generator.hands(rng, 3)
    centers = generator._centers(rng, 3)
    flesh = generator.flesh(rng, hands.joints * 150 + NYU.unproject(centers)[:, None], hands.scale)
    direct = normalise_depth(render_crop(flesh, centers, 300.0), centers[:, 2], 300.0)
    for n, whole in enumerate(render_image(flesh, NYU, background=9999.0)):
        assert (np.abs(direct[n] - crop(whole, centers[n], 300.0)) > 1e-3).sum() <= 5


def test_nothing_is_seen_outside_the_image() -> None:
    """Hands at the border of the image: no ragged edge reaches into crop pixels that no image pixel fills."""
    at_the_border = PosePrior(lateral_x=(-0.5, 0.02), lateral_y=(0.38, 0.02), depth=(550, 560))
    frames = Generator(prior=at_the_border).block(0)
    picked = window(frames.center_uvd, 300.0)
    outside = (picked.columns < 0)[:, None, :] | (picked.rows < 0)[:, :, None]
    assert outside.any(axis=(1, 2)).mean() > 0.9
    touching = outside & np.pad(frames.depth[:, 0] < 1, ((0, 0), (0, 1), (0, 0)))[:, 1:]
    assert touching.any()  # the hand is cut by the border
    assert (frames.depth[:, 0][outside] == 1).all()


def test_forearm_does_not_point_at_the_camera(generator: Generator) -> None:
    """The last capsule, the forearm, keeps to the side, and is in all crops long enough to leave them or the cube."""
    rng = np.random.default_rng(0)
    hands = generator.hands(rng, 300)
    flesh = generator.flesh(rng, hands.joints * 150 + (0, 0, 800), hands.scale)
    arm = flesh.b[:, -1] - flesh.a[:, -1]
    assert (arm[:, 2] / np.linalg.norm(arm, axis=1)).min() >= -HandShape().forearm_towards_camera - 1e-9


# ---------------------------------------------------------------------------------------- against reality


@pytest.mark.parametrize("frame", [0, 772])
def test_real_hands(nyu_data: Path, generator: Generator, frame: int) -> None:
    """Flesh on the annotated joints of a real frame covers the real hand and lies at its depth."""
    published = cv2.imread(str(nyu_data / "crops" / f"{frame}.png"), cv2.IMREAD_GRAYSCALE)
    assert published is not None
    real = published / 127.5 - 1
    uvd = np.load(nyu_data / "test_joint_uvd.npz")["joint_uvd"][frame].astype(float)
    joints = NYU.unproject(uvd[list(ANNOTATION_OF_JOINT)])[None]
    flesh = generator.flesh(np.random.default_rng(0), joints, np.ones(1))
    hand = Capsules(*(values[:, :-1] for values in flesh))  # without the forearm, whose direction is not annotated
    center = uvd[None, CENTER_JOINT]
    made = normalise_depth(render_crop(hand, center, 300.0), center[:, 2], 300.0)[0]
    wrist = int(crop_pixels(uvd[None, 30:32], center, 300.0)[0, :, 1].min())
    a, b = real[:wrist] < 0.99, made[:wrist] < 0.99
    assert (a & b).sum() / (a | b).sum() > 0.8
    apart = (made[:wrist] - real[:wrist])[a & b] * 150
    assert abs(np.median(apart)) < 3
    assert np.abs(apart).mean() < 6


def test_crops_look_like_real_ones(frames: Frames) -> None:
    """As much background as real crops have (67% and 73%), and hands at the same depth (median -27 mm)."""
    background = (frames.depth == 1).mean(axis=(1, 2, 3))
    assert 0.65 < np.median(background) < 0.85
    assert np.median(frames.depth[frames.depth < 1]) * 150 == pytest.approx(-27, abs=12)


def test_mistakes() -> None:
    """Impossible numbers and splits are named."""
    for make, message in (
        (lambda: Generator(-1), "seed -1"),
        (lambda: Generator(0, "tset"), "'tset', expected one of train, test"),  # type: ignore[arg-type]
        (lambda: list(generate(-1, Generator())), "-1 frames"),
        (lambda: list(generate(1, Generator(), workers=0)), "0 worker processes"),
    ):
        with pytest.raises(DataError, match=message):
            make()
