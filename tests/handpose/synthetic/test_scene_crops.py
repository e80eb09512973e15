"""handpose/synthetic/scene_crops.py, as the recipe "in_scenes" draws them"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handpose.frames.crops import crop_pixels
from handpose.synthetic.generator import Generator, Recipe, Scene
from handpose.synthetic.recipes import recipe
from netlib.blob import Array


@pytest.fixture(scope="module")
def in_scenes() -> Recipe:
    return recipe("in_scenes")


@pytest.fixture(scope="module")
def scene(in_scenes: Recipe) -> Scene:
    """A block of hands in scenes."""
    return Generator(5, "train", in_scenes).scene(3)


def readings_at(scene: Scene, joints: Array) -> Array:
    """The distance in mm from each joint (N, K) to the surface in front of it; NaN where the crop
    shows none.
    """
    half = scene.cube_mm / 2
    center = scene.camera.unproject(scene.center_uvd)
    uvd = scene.camera.project(joints * half + center[:, None])
    at = crop_pixels(uvd, scene.center_uvd, scene.cube_mm, scene.camera)
    column, row = np.rint(np.moveaxis(at, -1, 0)).astype(int).clip(0, scene.depth.shape[1] - 1)
    shown = scene.depth[np.arange(len(joints))[:, None], row, column].astype(float)
    shown[shown == 1] = np.nan
    return np.asarray((joints[..., 2] - shown) * half)


def test_every_second_block_is_in_scenes(in_scenes: Recipe) -> None:
    """The other blocks are those of hands alone."""
    mixed, alone = (Generator(5, "train", r) for r in (in_scenes, replace(in_scenes, around=None)))
    assert_array_equal(mixed.block(2).depth, alone.block(2).depth)
    shown = [(generator.block(3).depth < 1).mean() for generator in (mixed, alone)]
    assert shown[0] > 1.2 * shown[1]


def test_a_block_depends_on_seed_split_and_number_alone(in_scenes: Recipe, scene: Scene) -> None:
    generator = Generator(5, "train", in_scenes)
    generator.block(1)
    again = generator.scene(3)
    assert_array_equal(again.depth, scene.depth)
    assert_array_equal(again.bodies.joints, scene.bodies.joints)
    for other in (Generator(6, "train", in_scenes), Generator(5, "test", in_scenes)):
        assert not np.array_equal(other.scene(3).depth, scene.depth)


def test_joints_lie_behind_the_surface_that_the_crop_shows(scene: Scene) -> None:
    """Most are within a finger of it; those of another crop are not."""

    def share(joints: Array) -> float:
        behind_mm = readings_at(scene, joints)
        return float(((behind_mm > -5) & (behind_mm < 40)).mean())

    assert share(scene.bodies.joints) > 0.5
    assert share(np.roll(scene.bodies.joints, 1, axis=0)) < 0.25


def test_errors_are_larger_in_crops_of_far_hands(in_scenes: Recipe) -> None:
    """They have the size of a camera's pixels: the same reading is repeated more often."""
    generator = Generator(5, "train", in_scenes)
    scenes = [generator.scene(number) for number in (1, 3, 5, 7)]
    depth = np.concatenate([scene.depth for scene in scenes])
    far = np.concatenate([scene.center_uvd[:, 2] for scene in scenes]) > 700
    read = (depth[:, :, 1:] < 1) & (depth[:, :, 1:] > -1)
    again = (np.diff(depth, axis=2) == 0) & read
    share = again.sum((1, 2)) / read.sum((1, 2))
    assert np.median(share[far]) > 1.3 * np.median(share[~far])


def test_inputs_of_the_root_are_unknown(in_scenes: Recipe, scene: Scene) -> None:
    """The scene turns and moves its hands; the files leave these columns out."""
    generator = Generator(5, "train", in_scenes)
    root = [*generator.sampler.rotation, *generator.sampler.translation]
    assert np.isnan(scene.bodies.inputs[:, root]).all()
    assert np.isfinite(np.delete(scene.bodies.inputs, root, axis=1)).all()
    assert not {"dof", "bones"} & set(generator.block(3).arrays())
