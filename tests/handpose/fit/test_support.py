"""handpose/fit/support.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handpose.fit.body import CapsuleModel
from handpose.fit.support import FAR_MM, Support, joint_depths, support, support_of_parts
from handpose.frames.cameras import KINECT2
from handpose.sequences.recordings import render_image

CAMERA = replace(KINECT2, width=512, height=424)
CENTER = np.array([[0.0, 0.0, 500.0]])


@pytest.fixture(scope="module")
def image(model: CapsuleModel) -> np.ndarray:
    """The depth image of a hand at rest, in front of a wall."""
    return render_image(model.capsules(np.zeros((1, model.variables)), CENTER), CAMERA, background=1500.0)[0]


def of(model: CapsuleModel, image: np.ndarray, move: tuple[float, ...] = (0, 0, 0)) -> Support:
    """The support of that hand, moved."""
    capsules = model.capsules(np.zeros((1, model.variables)), CENTER + np.array(move))
    return support(capsules, model.surface.limbs, image, CAMERA)


@pytest.mark.parametrize(
    ("value", "part"), [(30, "hidden"), (300, "hidden"), (0, "missing"), (np.nan, "missing"), (900, "empty")]
)
def test_covered(model: CapsuleModel, image: np.ndarray, value: float, part: str) -> None:
    """A part of the hand that is covered, not read, or farther than the pose counts in proportion to its area."""
    assert of(model, image).seen[0] > 0.97  # although parts of the hand cover others
    half = image.copy()
    columns = np.flatnonzero((image < 700).any(axis=0))
    half[:, columns[0] : int(columns.mean())] = value
    found, whole = of(model, half), of(model, np.full_like(image, value))
    assert 0.25 < getattr(found, part)[0] < 0.75 and found.seen[0] > 0.2
    assert getattr(whole, part)[0] == pytest.approx(1) and whole.seen[0] == 0
    assert sum(share[0] for share in found) == pytest.approx(1)


def test_parts(model: CapsuleModel, image: np.ndarray) -> None:
    """Of a hand whose index finger is covered, only that finger is hidden; shares of disjoint parts make the whole."""
    assert model.fingers is not None
    index, others = model.fingers.capsules[1], ~model.fingers.capsules[1] & ~model.surface.limbs
    capsules = model.capsules(np.zeros((1, model.variables)), CENTER)
    u, v, _ = np.rint(CAMERA.project(np.concatenate([capsules.a[0, index], capsules.b[0, index]]))).astype(int).T
    covered = image.copy()
    covered[v.min() - 9 : v.max() - 15, u.min() - 9 : u.max() + 9] = 200
    whole, *parts = support_of_parts(capsules, model.surface.limbs, [index, others], covered, CAMERA)
    assert whole == support(capsules, model.surface.limbs, covered, CAMERA)
    assert parts[0].hidden[0] > 0.5 > 0.2 > parts[1].hidden[0]
    assert min(part.seen[0] for part in parts) < whole.seen[0] < max(part.seen[0] for part in parts)


def test_elsewhere(model: CapsuleModel, image: np.ndarray) -> None:
    """A pose next to the hand is in empty space; a part of it may be outside the image, or behind the camera."""
    assert of(model, image, (250, 0, 0)).empty[0] > 0.9
    half = (-(CAMERA.u0 / CAMERA.fx) * CENTER[0, 2], 0, 0)
    assert 0.2 < of(model, image, half).outside[0] < 0.8
    for away in ((2000, 0, 0), (0, 0, -2000)):
        assert of(model, image, away).outside[0] == pytest.approx(1)


def test_joints_in_the_image(image: np.ndarray) -> None:
    """Joints are behind or in front of the readings at their pixels; those without a reading do not count."""
    v, u = np.argwhere(image < 700)[200]
    surface, d = CAMERA.unproject([u, v, image[v, u]]), float(image[v, u])
    joints = np.stack([surface * (1 + dz / d) for dz in (12, -30, 500)])[None]
    found = joint_depths(joints, image, CAMERA)
    np.testing.assert_allclose([found.behind[0], found.before[0]], [(12 + FAR_MM) / 3, 10], rtol=1e-4)
    missing = image.copy()
    missing[v, u] = np.nan
    for nothing in (missing, np.zeros_like(image)):
        assert [*np.ravel(joint_depths(joints, nothing, CAMERA))] == [0, 0]
