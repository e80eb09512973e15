"""handpose/synthetic/generator.py"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handpose.body.capsules import Capsules
from handpose.body.joint_formats.frames import palm_frame
from handpose.body.nyu import ANNOTATION_OF_JOINT, CENTER_JOINT
from handpose.body.render import normalise_depth, render_crop
from handpose.datasets.frames import Frames
from handpose.frames.cameras import NYU
from handpose.frames.crops import crop_pixels, restore_joints, window
from handpose.synthetic import prior_file, recipes
from handpose.synthetic.generator import BLOCK, VERSION, Generator, Recipe, SyntheticCamera
from handpose.synthetic.prior_parameters import NormalParameter, RangeParameter
from netlib.files.paths import ROOT


def test_arrays_have_a_row_for_each_frame(frames: Frames) -> None:
    """Their values are in their ranges."""
    for name, array in frames.arrays().items():
        assert len(array) == BLOCK
        assert array.dtype == (np.int64 if name == "index" else np.float32)
        assert np.isfinite(array).all()
        if name in ("depth", "joint"):
            assert array.min() >= -1 and array.max() == 1
    assert_array_equal(frames.index, np.arange(BLOCK))


def test_frames_depend_on_seed_split_and_number_only(generator: Generator, frames: Frames) -> None:
    """A generator gives the same frames regardless of earlier blocks; another seed, split or
    block differs.
    """
    generator.block(3)
    for name, array in generator.block(0).arrays().items():
        assert_array_equal(array, frames.arrays()[name], name)
    for other in (Generator(8).block(0), Generator(7, "test").block(0), generator.block(1)):
        assert (np.abs(other.joint - frames.joint).max(axis=1) > 0.05).all()


def test_joints_are_inside_the_surface() -> None:
    """Along a joint's ray the surface is in front of the joint, by a median of about 12 mm."""
    frames = Generator(seed=3, recipe=Recipe(views=(SyntheticCamera(NYU, None),))).block(0)
    joints = frames.joint.reshape(-1, 31, 3).astype(float)
    xyz = restore_joints(joints, frames.center, frames.half_cube)
    at = np.rint(crop_pixels(NYU.project(xyz), frames.center_uvd, 300.0)).astype(int)
    is_in_crop = ((at >= 0) & (at < 128)).all(axis=2)
    is_in_cube = (np.abs(joints) < 0.99).all(axis=2)
    n, k = np.nonzero(is_in_crop & is_in_cube)
    assert len(n) > 1800
    surface = frames.depth[n, 0, at[n, k, 1], at[n, k, 0]]
    gap = (joints[n, k, 2] - surface) * 150
    assert (gap > -1).all()
    assert np.median(gap) == pytest.approx(12, abs=6)


def test_crop_pixels_outside_the_image_are_background() -> None:
    """The hands are at the image border."""
    at_the_border = prior_file.load().but(
        lateral_x=NormalParameter(-0.5, 0.02),
        lateral_y=NormalParameter(0.38, 0.02),
        depth=RangeParameter(550, 560),
    )
    frames = Generator(recipe=Recipe(at_the_border)).block(0)
    picked = window(frames.center_uvd, 300.0)
    outside = (picked.columns < 0)[:, None, :] | (picked.rows < 0)[:, :, None]
    assert outside.any(axis=(1, 2)).mean() > 0.9
    touching = outside & np.pad(frames.depth[:, 0] < 1, ((0, 0), (0, 1), (0, 0)))[:, 1:]
    assert touching.any()  # the border cuts the hand
    assert (frames.depth[:, 0][outside] == 1).all()


def test_recipes_differ_and_draw_bodies_in_sight() -> None:
    generators = [Generator(3, "test", recipes.recipe(name)) for name in recipes.NAMES]
    assert len({json.dumps(generator.made_from()) for generator in generators}) == len(
        recipes.NAMES
    )
    for depth in (generator.scene(1).depth for generator in generators):
        assert np.isfinite(depth).all() and (depth < 1).any(axis=(1, 2)).all()


def test_the_recipe_cameras_uses_all_views_and_rolls() -> None:
    """Its hands are near and far."""
    scenes = [
        Generator(3, "train", recipes.recipe("cameras")).scene(number) for number in range(12)
    ]
    assert len({scene.camera.name for scene in scenes}) == 4
    depth = np.concatenate([scene.center_uvd[:, 2] for scene in scenes])
    assert depth.min() < 300 and depth.max() > 1100
    roll = np.concatenate([scene.bodies.inputs[:, 5] for scene in scenes])
    assert (np.histogram(roll, 4, (-np.pi, np.pi))[0] / len(roll) > 0.12).all()


# ---------------------------------------------------------------------------------- against reality


@pytest.mark.parametrize("frame", [0, 772])
def test_a_rendered_hand_covers_the_real_one(
    nyu_data: Path, generator: Generator, frame: int
) -> None:
    """The surface on a real frame's annotated joints covers the real hand and lies at its depth."""
    published = cv2.imread(str(nyu_data / "crops" / f"{frame}.png"), cv2.IMREAD_GRAYSCALE)
    assert published is not None
    real = published / 127.5 - 1
    uvd = np.load(nyu_data / "test_joint_uvd.npz")["joint_uvd"][frame].astype(float)
    joints = NYU.unproject(uvd[list(ANNOTATION_OF_JOINT)])[None]
    surface = generator.sampler.surface
    palm = palm_frame(joints[0], generator.sampler.skeleton)[None]
    of_surface = np.zeros((1, len(surface.whole.joint_names) - 31, 3))
    joints = np.concatenate([joints, of_surface], axis=1) / 150
    ends = surface.ends_at(joints, dict.fromkeys(surface.offsets, palm)) * 150
    own = ~surface.limbs  # without the forearm, whose direction is not annotated
    radii = surface.radii[None, own] * 150
    hand = Capsules(
        ends[:, surface.start[own]], ends[:, surface.end[own]], radii[..., 0], radii[..., 1]
    )
    center = uvd[None, CENTER_JOINT]
    made = normalise_depth(render_crop(hand, center, 300.0), center[:, 2], 300.0)[0]
    wrist = int(crop_pixels(uvd[None, 30:32], center, 300.0)[0, :, 1].min())
    a, b = real[:wrist] < 0.99, made[:wrist] < 0.99
    assert (a & b).sum() / (a | b).sum() > 0.8
    apart = (made[:wrist] - real[:wrist])[a & b] * 150
    assert abs(np.median(apart)) < 3
    assert np.abs(apart).mean() < 6


def test_crops_look_like_real_ones(generator: Generator) -> None:
    """Crops have as much background as real ones (67% and 73%), and hands at the same depth
    (median -27 mm).
    """
    depth = np.concatenate([generator.block(number).depth for number in range(4)])
    assert 0.65 < np.median((depth == 1).mean(axis=(1, 2, 3))) < 0.85
    assert np.median(depth[depth < 1]) * 150 == pytest.approx(-27, abs=15)


def test_the_present_version_is_documented() -> None:
    text = (ROOT / "docs" / "training.md").read_text(encoding="utf-8")
    assert f"the code makes version {VERSION})" in " ".join(text.split())
