"""handpose/drawing/comparisons.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.drawing import comparisons, hands, strokes
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from netlib.blob import Array

SKELETON = skeletons.load()
CROPS = [np.full((128, 128), 1.0), np.full((128, 128), 0.5)]


@pytest.fixture
def joints() -> Array:
    """Two hands."""
    inputs = np.random.default_rng(0).normal(0, 0.1, (2, len(SKELETON.initial)))
    return np.asarray(kinematics_of(SKELETON).joints(inputs))


def test_two_views(joints: Array) -> None:
    """A frame has two cells, on the crop and in space, with a title each."""
    titles = [("frame 0", "1 mm"), ("frame 7", "2 mm")]
    drawn = comparisons.two_views(CROPS, joints, joints[:, ::-1], SKELETON, titles, columns=2)
    cells = []
    for crop, hand, truth in zip(CROPS, joints, joints[:, ::-1]):
        cells += [hands.overlay(crop, hand, SKELETON, truth, zoom=3), hands.view_3d(hand, SKELETON, truth, size=384)]
    assert np.array_equal(drawn, strokes.sheet(cells, 2, ["frame 0", "1 mm", "frame 7", "2 mm"]))


def test_an_annotation_of_other_joints_is_not_drawn(joints: Array) -> None:
    """ICVL's 16 joints are no skeleton of 31."""
    titles = [("a", "b"), ("c", "d")]
    few = comparisons.two_views(CROPS, joints, joints[:, :16], SKELETON, titles)
    assert few.shape == comparisons.two_views(CROPS, joints, joints, SKELETON, titles).shape
    assert not np.array_equal(few, comparisons.two_views(CROPS, joints, joints, SKELETON, titles))


def test_side_by_side(joints: Array) -> None:
    """A method per column, with its mean error in mm."""
    moved = joints + (0.1, 0, 0)
    drawn = comparisons.side_by_side(CROPS, {"A": joints, "B": moved}, joints, SKELETON, np.array([150.0, 100.0]))
    cells = [
        hands.overlay(crop, hand, SKELETON, truth, zoom=2)
        for crop, truth, pair in zip(CROPS, joints, zip(joints, moved))
        for hand in pair
    ]
    assert np.array_equal(drawn, strokes.sheet(cells, 2, ["A, 0 mm", "B, 15 mm", "A, 0 mm", "B, 10 mm"]))
