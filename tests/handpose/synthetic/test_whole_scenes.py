"""handpose/synthetic/whole_scenes.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handpose.synthetic.scenes.cameras import HEIGHT, WIDTH
from handpose.synthetic.whole_scenes import HAND, OTHER, PERSON, SceneGenerator, Scenes


@pytest.fixture(scope="module")
def generator() -> SceneGenerator:
    return SceneGenerator(7)


@pytest.fixture(scope="module")
def scenes(generator: SceneGenerator) -> Scenes:
    return generator.block(3)


def test_a_block_depends_on_seed_split_and_number_alone(scenes: Scenes) -> None:
    generator = SceneGenerator(7)
    generator.block(0)
    for own, again in zip(scenes, generator.block(3), strict=True):
        assert_array_equal(own, again)
    assert not np.array_equal(scenes.depth, SceneGenerator(7, "test").block(3).depth)


def test_the_labels_agree_with_each_other(scenes: Scenes) -> None:
    """Hands and pixels; the pixels of hands lie within a hand's length of the palm."""
    assert_array_equal(scenes.classes == HAND, scenes.which > 0)
    assert not (scenes.present & scenes.doubtful).any() and scenes.present.sum() > 8
    for n, k in np.argwhere(scenes.present):
        column, row = scenes.middle_px[n, k]
        assert 0 < column < WIDTH and 0 < row < HEIGHT
        pixels = (scenes.which[n] == k + 1) & (scenes.depth[n] > 0)
        rays = np.concatenate([scenes.slopes[n], np.ones((HEIGHT, WIDTH, 1))], axis=-1)
        points = rays * scenes.depth[n][..., None]
        apart = np.linalg.norm(points[pixels] - scenes.middle[n, k], axis=1)
        assert np.median(apart) < 130


def test_each_pixel_says_what_it_shows(generator: SceneGenerator, scenes: Scenes) -> None:
    shown = np.array(generator.names)[scenes.what]
    assert_array_equal(scenes.classes == HAND, shown == "hand")
    assert_array_equal(scenes.classes == PERSON, shown == "person")
    assert {"nothing", "table", "planes", "box", "head", "stick"} <= set(
        shown[scenes.classes == OTHER]
    )


def test_hands_send_back_enough_light_to_be_seen() -> None:
    """Of things in the same frames, dark ones are lost as a whole."""
    lost, there = {"hand": 0, "thing": 0}, {"hand": 0, "thing": 0}
    for number in range(4):
        scenes = SceneGenerator(5).block(number)
        names = np.array(SceneGenerator(5).names)
        first_thing = list(names).index("box")
        for name, pixels in (
            ("hand", scenes.classes == HAND),
            ("thing", scenes.what >= first_thing),
        ):
            there[name] += pixels.sum()
            lost[name] += (pixels & (scenes.depth == 0)).sum()
    assert lost["hand"] / there["hand"] < 0.5 * lost["thing"] / there["thing"]
