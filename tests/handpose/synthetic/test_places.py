"""handpose/synthetic/places.py"""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.places import CUBE_MM, SIZE
from handpose.synthetic import places, scenes
from handpose.synthetic.files import generate
from handpose.synthetic.generator import BLOCK
from handpose.synthetic.places import BEYOND_MM, PER_SCENE, UNKNOWN, WITHIN_MM, PlaceGenerator, PlaceRows
from handpose.synthetic.recipes import any_roll


@pytest.fixture(scope="module")
def block() -> PlaceRows:
    """The places of four scenes."""
    return PlaceGenerator(3).block(1)


def test_labels(block: PlaceRows) -> None:
    """Places near a hand are labelled with the offset; those far from one are not; those between are unknown."""
    hand, offset = block.hand, np.linalg.norm(block.offset, axis=1) * CUBE_MM / 2
    assert {0.0, 1.0} <= set(hand.tolist()) <= {0.0, 1.0, UNKNOWN}
    assert 0.3 < (hand == 1).mean() < 0.7
    assert (offset[hand == 1] < WITHIN_MM).all() and (offset[hand == 1] > 0).all() and (offset[hand != 1] == 0).all()
    np.testing.assert_array_equal(block.near, np.repeat((hand == 1)[:, None], 3, axis=1))
    assert WITHIN_MM < BEYOND_MM
    assert block.depth.shape == (BLOCK, 1, SIZE, SIZE) and np.abs(block.depth).max() <= 1


def test_offsets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Offsets lead from each crop's middle to the hand's; for mirrored crops x is negated."""
    returned: list[tuple[np.ndarray, np.ndarray]] = []
    original = places.place_crops
    hands: list[np.ndarray] = []

    def cut(depth: np.ndarray, chosen: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        returned.append(original(depth, chosen, camera))
        return returned[-1]

    def draw(*args: object, **options: object) -> scenes.Scenes:
        drawn = scenes.draw_scenes(*args, **options)  # type: ignore[arg-type]
        hands.append(drawn.center[0])
        return drawn

    monkeypatch.setattr(places, "place_crops", cut)
    monkeypatch.setattr(places, "draw_scenes", draw)
    block = PlaceGenerator(3).block(1)
    mirrored = 0
    for n in np.flatnonzero(block.hand == 1):
        (crops, kept), hand = returned[n // PER_SCENE], hands[n // PER_SCENE]
        own = n % PER_SCENE % len(kept)
        expected = (hand - kept[own]) / (CUBE_MM / 2)
        if not np.array_equal(crops[own], block.depth[n, 0]):
            np.testing.assert_array_equal(crops[own][:, ::-1], block.depth[n, 0])
            expected, mirrored = expected * (-1, 1, 1), mirrored + 1
        np.testing.assert_allclose(block.offset[n], expected, atol=1e-6)
    assert 0 < mirrored < (block.hand == 1).sum()


def test_the_same_places(block: PlaceRows) -> None:
    """The same seed gives the same places, in another process too; another seed or split gives others."""
    generator = pickle.loads(pickle.dumps(PlaceGenerator(3)))
    for name, values in generator.block(1).arrays().items():
        np.testing.assert_array_equal(values, getattr(block, name))
    assert not np.array_equal(PlaceGenerator(3, "test").block(1).depth, block.depth)
    assert generator.made_from() != PlaceGenerator(4).made_from()
    assert block.index.tolist() == list(range(BLOCK, 2 * BLOCK))


def test_what_they_are_made_from(monkeypatch: pytest.MonkeyPatch) -> None:
    """A change of the hands' prior changes the recipe, so that files are made again."""
    before = json.dumps(PlaceGenerator(3).made_from())
    monkeypatch.setattr(places, "any_roll", lambda: any_roll().but(scale_std=0.2))
    assert json.dumps(PlaceGenerator(3).made_from()) != before


def test_a_few_of_them(block: PlaceRows) -> None:
    """``generate`` returns a part of a block, with the columns of the files."""
    (few,) = generate(3, PlaceGenerator(3), start=BLOCK)
    np.testing.assert_array_equal(few.depth, block.depth[:3])
    columns = PlaceGenerator(3).columns()
    for name, values in few.arrays().items():
        assert columns[name].dtype == values.dtype and columns[name].shape == (0, *values.shape[1:])
