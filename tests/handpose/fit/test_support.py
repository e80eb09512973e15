"""handpose/fit/support.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handpose.body.render import render
from handpose.fit.body import CapsuleModel
from handpose.fit.support import Support, support
from handpose.frames.cameras import KINECT2

CAMERA = replace(KINECT2, width=512, height=424)
CENTER = np.array([[0.0, 0.0, 500.0]])


@pytest.fixture(scope="module")
def image(model: CapsuleModel) -> np.ndarray:
    """The depth image of a hand at rest, in front of a wall."""
    x, y = (np.arange(512) - CAMERA.u0) / CAMERA.fx, (np.arange(424) - CAMERA.v0) / CAMERA.fy
    return render(model.capsules(np.zeros((1, model.variables)), CENTER), x[None], y[None], [1500.0])[0]


def of(model: CapsuleModel, image: np.ndarray, move: tuple[float, ...] = (0, 0, 0)) -> Support:
    """The support of that hand, moved."""
    capsules = model.capsules(np.zeros((1, model.variables)), CENTER + np.array(move))
    return support(capsules, model.surface.limbs, image, CAMERA)


def test_a_hand_at_its_place(model: CapsuleModel, image: np.ndarray) -> None:
    """Nearly all of the surface is seen, although parts of the hand cover others."""
    assert of(model, image).seen[0] > 0.97


@pytest.mark.parametrize(
    ("value", "part"), [(30, "hidden"), (300, "hidden"), (0, "missing"), (np.nan, "missing"), (900, "empty")]
)
def test_covered(model: CapsuleModel, image: np.ndarray, value: float, part: str) -> None:
    """A part of the hand that is covered, not read, or farther than the pose counts in proportion to its area."""
    half = image.copy()
    columns = np.flatnonzero((image < 700).any(axis=0))
    half[:, columns[0] : int(columns.mean())] = value
    found, whole = of(model, half), of(model, np.full_like(image, value))
    assert 0.25 < getattr(found, part)[0] < 0.75 and found.seen[0] > 0.2
    assert getattr(whole, part)[0] == pytest.approx(1) and whole.seen[0] == 0
    assert sum(share[0] for share in found) == pytest.approx(1)


def test_elsewhere(model: CapsuleModel, image: np.ndarray) -> None:
    """A pose next to the hand is in empty space; outside the image there is no support of any kind."""
    assert of(model, image, (250, 0, 0)).empty[0] > 0.9
    assert sum(share[0] for share in of(model, image, (2000, 0, 0))) == 0
