"""experiments/scenes.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.scenes import (
    FINER,
    SceneHand,
    SceneHands,
    cells_of,
    hands_in,
    other_setting,
    predictors,
)
from handpose.estimate.hand import HandEstimate
from handpose.frames.cameras import NYU
from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.whole_scenes import SceneGenerator
from netlib.blob import Array
from tests.support.running import run_tool

JOINTS = np.random.default_rng(3).normal(0, 60, (31, 3)) + (0, 0, 600)


def estimated(joints: Array, confidence: float) -> HandEstimate:
    """A right hand with these joints in mm."""
    crop, place = np.ones((128, 128), np.float32), NYU.project(np.zeros(3) + (0, 0, 600))
    hand = HandEstimate("right", crop, place, 300.0, NYU, joints - (0, 0, 600))
    return replace(hand, confidence=confidence)


def test_the_figures_of_hands() -> None:
    """A hand is missed, one is the other side's, one is 20 mm off, one 40 mm."""
    off = [estimated(JOINTS + (mm, 0, 0), confidence) for mm, confidence in ((20, 0.95), (40, 0.9))]
    hands = [
        SceneHand(JOINTS, "right", None),
        SceneHand(JOINTS, "left", off[0]),
        *(SceneHand(JOINTS, "right", estimate) for estimate in off),
    ]
    false = [estimated(JOINTS, 0.2), estimated(JOINTS, 0.4)]
    cells = cells_of([SceneHands(hands, false), SceneHands([], [])])
    assert (cells["hands"], cells["found"], cells["side"]) == ("4", "75%", "67%")
    assert (cells["mean"], cells["median"], cells["same"]) == ("30.0", "30.0", "0.0")
    assert (cells["joints"], cells["good"]) == ("100%", "33%")
    assert (cells["sure"], cells["off"], cells["false"]) == ("3", "66.7%", "0.50")


def test_hands_of_a_scene_are_found_once_and_fitted() -> None:
    """Their errors are those of a fit; none is also counted as false."""
    generator = SceneGenerator(8000, "test", finer=FINER)
    scenes = list(hands_in(generator, 32, predictors("fast")))
    hands = [hand for scene in scenes for hand in scene.hands]
    found = [hand for hand in hands if hand.estimate]
    in_sight = sum(generator.block(number).present.sum() for number in (0, 1))
    assert len(hands) == in_sight and len(found) > len(hands) / 2
    right = [hand.error_mm for hand in found if np.isfinite(hand.error_mm)]
    assert np.median(right) < 40
    for scene in scenes:
        for false in scene.false:
            assert all(
                np.linalg.norm(false.xyz.mean(0) - hand.joints.mean(0)) > 1 for hand in scene.hands
            )


def test_the_other_setting_differs_and_both_are_reported() -> None:
    assert other_setting() != scene_prior.load()
    done = run_tool("experiments.__main__ scenes", "--scenes", "2", "--fit", "fast")
    head, *rows = done.out.splitlines()[-3:]
    assert head.split()[:4] == ["scenes", "hands", "found", "side"]
    assert [row.split()[0] for row in rows] == ["training", "other"]


@pytest.mark.parametrize("finer", [1, 2])
def test_finer_frames_show_the_same_scenes(finer: int) -> None:
    """The hands are the same; there are more pixels."""
    one, other = (SceneGenerator(7, finer=factor).block(0) for factor in (1, finer))
    assert other.depth.shape[1] == finer * one.depth.shape[1]
    np.testing.assert_array_equal(other.joints, one.joints)
    np.testing.assert_allclose(other.middle_px, finer * one.middle_px)
