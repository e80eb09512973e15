"""handpose/predicting/candidates.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.facts.cameras import NYU
from handpose.predicting.candidates import APART_MM, candidates
from handpose.predicting.finding import find_hand
from handpose.synthetic.scenes import KINDS, draw_scenes
from netlib.errors import DataError


def test_a_place_is_near_the_hand() -> None:
    """In 30 scenes with forearms before the hand, bodies behind it and things beside it, one place is near enough."""
    scenes = draw_scenes(np.random.default_rng(5), 30)
    nearest = []
    for depth, center in zip(scenes.depth, scenes.center):
        places = NYU.unproject(candidates(depth, NYU))
        nearest.append(np.linalg.norm(places - center, axis=1).min())
        apart = np.linalg.norm(places[:, None] - places, axis=2) + 1e9 * np.eye(len(places))
        assert apart.min() > APART_MM and len(places) < 40
    assert (np.array(nearest) < 75).mean() > 0.9
    alone = [np.linalg.norm(NYU.unproject(find_hand(d, NYU)) - c) < 75 for d, c in zip(scenes.depth, scenes.center)]
    assert np.mean(alone) < 0.7  # the nearest thing is the forearm, the table or a bottle too often


def test_both_ends_of_a_stick() -> None:
    """A stick as thick as an arm, half a metre long, across the picture: its ends are places."""
    depth = np.zeros((480, 640))
    depth[220:260, 100:540] = 700
    places = NYU.unproject(candidates(depth, NYU))
    x = np.sort(places[:, 0])
    assert x[0] < -170 and x[-1] > 170 and np.abs(places[:, 1]).max() < 30


def test_what_was_not_read_parts_nothing() -> None:
    """A stick with a gap of one node is one thing."""
    depth = np.zeros((480, 640))
    depth[220:260, 100:540] = 700
    depth[:, 318:322] = 0
    assert len(candidates(depth, NYU)) <= 3


def test_the_nearest_thing_is_always_tried() -> None:
    """First of all."""
    scenes = draw_scenes(np.random.default_rng(6), 3)
    np.testing.assert_allclose(candidates(scenes.depth[0], NYU)[0], find_hand(scenes.depth[0], NYU))


def test_nothing_to_be_seen() -> None:
    """Is one line."""
    with pytest.raises(DataError, match="no depth anywhere in the image"):
        candidates(np.zeros((480, 640)), NYU)


def test_scenes() -> None:
    """Images of every kind in turn, the same for the same seed, the hand in sight; a forearm that is nearer than it."""
    scenes = draw_scenes(np.random.default_rng(7), 9)
    again = draw_scenes(np.random.default_rng(7), 9)
    np.testing.assert_array_equal(scenes.depth, again.depth)
    assert scenes.kind == list(KINDS) * 3 and scenes.depth.shape == (9, 480, 640)
    for depth, center, joints, kind in zip(scenes.depth, scenes.center, scenes.joints, scenes.kind):
        u, v, d = NYU.project(center)
        assert 0 < u < 640 and 0 < v < 480 and 400 < d < 950
        assert np.linalg.norm(joints - center, axis=1).max() < 250
        seen = depth[depth > 0]
        if kind == "forearm":
            assert np.percentile(seen[seen < 1200], 2) < joints[:, 2].min() + 5
    behind = scenes.depth[1]
    assert ((behind > 700) & (behind < 1400)).sum() > 3000  # a body
