"""handpose/fitting/depth/strangeness.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.facts.cameras import NYU
from handpose.fitting.depth.body import FleshModel
from handpose.fitting.depth.strangeness import CAP_MM, OUTSIDE_MM, strangeness
from handpose.flesh.render import normalise_depth, render_crop


@pytest.fixture
def drawn(model: FleshModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A hand, the crop that shows it, and where that was cut."""
    x, uvd = np.zeros((1, model.variables)), np.array([[320.0, 240, 700]])
    depth = render_crop(model.capsules(x, NYU.unproject(uvd)), uvd, 300.0)
    return x, normalise_depth(depth, uvd[:, 2], 300.0), uvd


def test_a_hand_is_not_strange(model: FleshModel, drawn: tuple[np.ndarray, ...]) -> None:
    """Where it is, predicted where it is: nothing."""
    x, crop, uvd = drawn
    assert strangeness(model, x, model.joints(x), crop, uvd, NYU)[0] < 0.1


def test_each_figure(model: FleshModel, drawn: tuple[np.ndarray, ...]) -> None:
    """An empty picture, a prediction 20 mm away, a hand beside the image: each adds its own."""
    x, crop, uvd = drawn
    joints = model.joints(x)
    own = strangeness(model, x, joints, crop, uvd, NYU)[0]
    assert strangeness(model, x, joints, np.ones_like(crop), uvd, NYU)[0] == pytest.approx(2 * CAP_MM, abs=1)
    moved = strangeness(model, x, joints + (20, 0, 0), crop, uvd, NYU)[0]
    assert moved == pytest.approx(own + 20, abs=1e-6)
    beside = np.array([[-300.0, 240, 700]])
    assert strangeness(model, x, joints, np.ones_like(crop), beside, NYU)[0] >= OUTSIDE_MM


def test_a_stick_on_one_finger_is_strange(model: FleshModel, drawn: tuple[np.ndarray, ...]) -> None:
    """Much of the hand is nowhere, however well the stick lies on the finger."""
    x, crop, uvd = drawn
    stick = np.where(np.arange(128) > 64, crop, 1.0).astype(np.float32)  # a part of the hand's own picture
    assert strangeness(model, x, model.joints(x), stick, uvd, NYU)[0] > 15
