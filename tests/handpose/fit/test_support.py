"""handpose/fit/support.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.body.capsules import Capsules
from handpose.fit.body import CapsuleModel
from handpose.fit.settings import SupportSettings
from handpose.fit.support import ImageSupport, Support
from handpose.frames.cameras import KINECT2
from handpose.sequences.recordings import render_image
from tests.handpose.fit.test_body import body

CAMERA = replace(KINECT2, width=512, height=424)
CENTER = np.array([[0.0, 0.0, 500.0]])
IMAGES = ImageSupport(SupportSettings())


def at_rest(model: CapsuleModel, move: tuple[float, ...] = (0, 0, 0)) -> Capsules:
    """The capsules of a body at rest, moved from the centre."""
    return model.capsules(np.zeros((1, model.variables)), CENTER + np.array(move))


@pytest.fixture(scope="module")
def image(model: CapsuleModel) -> np.ndarray:
    """The depth image of a hand at rest, in front of a wall."""
    return render_image(at_rest(model), CAMERA, background=1500.0)[0]


def of(model: CapsuleModel, image: np.ndarray, move: tuple[float, ...] = (0, 0, 0)) -> Support:
    """The support of that hand, moved."""
    return IMAGES.support(at_rest(model, move), model.surface.limbs, image, CAMERA)


@pytest.mark.parametrize(
    ("value", "part"),
    [(30, "hidden"), (300, "hidden"), (0, "missing"), (np.nan, "missing"), (900, "empty")],
)
def test_parts_of_the_hand_count_in_proportion_to_their_area(
    model: CapsuleModel, image: np.ndarray, value: float, part: str
) -> None:
    """A part may be covered, not read, or farther than the pose."""
    assert of(model, image).seen[0] > 0.97  # although parts of the hand cover others
    half = image.copy()
    columns = np.flatnonzero((image < 700).any(axis=0))
    half[:, columns[0] : int(columns.mean())] = value
    found, whole = of(model, half), of(model, np.full_like(image, value))
    assert 0.25 < getattr(found, part)[0] < 0.75 and found.seen[0] > 0.2
    assert getattr(whole, part)[0] == pytest.approx(1) and whole.seen[0] == 0
    assert sum(share[0] for share in found) == pytest.approx(1)


def test_parts(model: CapsuleModel, image: np.ndarray) -> None:
    """Of a hand whose index finger is covered, only that finger is hidden; shares of disjoint parts
    make the whole.
    """
    assert model.fingers is not None
    index = model.fingers.capsules[1]
    capsules = at_rest(model)
    others = ~index & ~model.surface.limbs
    ends = np.concatenate([capsules.a[0, index], capsules.b[0, index]])
    u, v, _ = np.rint(CAMERA.project(ends)).astype(int).T
    covered = image.copy()
    covered[v.min() - 9 : v.max() - 15, u.min() - 9 : u.max() + 9] = 200
    whole, *parts = IMAGES.support_of_parts(
        capsules, model.surface.limbs, [index, others], covered, CAMERA
    )
    assert whole == IMAGES.support(capsules, model.surface.limbs, covered, CAMERA)
    assert parts[0].hidden[0] > 0.5 > 0.2 > parts[1].hidden[0]
    seen = [part.seen[0] for part in parts]
    assert min(seen) < whole.seen[0] < max(seen)


WEB = """name: "web" dof { name: "x" } joint { name: "a" translate { axis: X dof: "x" } }
joint { name: "b" parent: "a" bone { axis: X length: 10 } } joint { name: "c" parent: "a" bone { axis: Y length: 10 } }
flesh { wedge { joint: "a" joint: "b" joint: "c" radius: 0.1 } }
"""


def test_a_flat_part_between_thin_edges() -> None:
    """Covered by a square in its middle, a web is hidden there; a part without an edge has no
    web.
    """
    web = body(WEB)  # a triangle of 5,000 mm2
    readings = np.full((CAMERA.height, CAMERA.width), 500.0)
    corners = CENTER + [(10, 50, 0), (50, 10, 0)]
    (left, right), (top, bottom), _ = np.rint(CAMERA.project(corners)).astype(int).T
    readings[top : bottom + 1, left : right + 1] = 300
    none, two = np.zeros(3, bool), np.array([False, True, True])
    whole, part = IMAGES.support_of_parts(at_rest(web), none, [two], readings, CAMERA)
    assert whole.hidden[0] == pytest.approx(1600 / 5000, abs=0.05)
    assert whole.hidden[0] + whole.seen[0] == pytest.approx(1)
    assert (part.hidden[0], part.seen[0]) == (0, 1)


def test_shares_are_those_of_the_pixels(model: CapsuleModel, image: np.ndarray) -> None:
    """A bent hand is compared pixel by pixel with a rendering of itself, and with the image of
    another one.
    """
    limbs = model.surface.limbs
    for seed in range(4):
        x = np.random.default_rng(seed).normal(0, 0.4, (1, model.variables))
        capsules = model.capsules(x, CENTER)
        whole, own = (
            render_image(one, CAMERA, background=9e4)[0]
            for one in (capsules, capsules.chosen(~limbs))
        )
        shown = (own < 9e4) & (own <= whole + IMAGES.settings.self_mm)
        of_itself = IMAGES.support(capsules, limbs, whole, CAMERA)
        assert of_itself.seen[0] > 0.97
        found = IMAGES.support(capsules, limbs, image, CAMERA)
        apart = (image - own)[shown]
        tolerance = IMAGES.settings.tolerance_mm
        shares = [
            (np.abs(apart) <= tolerance).mean(),
            (apart < -tolerance).mean(),
            (apart > tolerance).mean(),
        ]
        assert_allclose([found.seen[0], found.hidden[0], found.empty[0]], shares, atol=0.1)


def test_a_pose_elsewhere_is_in_empty_space_or_outside_the_image(
    model: CapsuleModel, image: np.ndarray
) -> None:
    """A pose next to the hand is in empty space; a part of it may be outside the image, or
    behind the camera.
    """
    assert of(model, image, (250, 0, 0)).empty[0] > 0.8
    half = (-(CAMERA.u0 / CAMERA.fx) * CENTER[0, 2], 0, 0)
    assert 0.2 < of(model, image, half).outside[0] < 0.8
    for away in ((2000, 0, 0), (0, 0, -2000)):
        assert of(model, image, away).outside[0] == pytest.approx(1)


def test_joints_in_the_image(image: np.ndarray) -> None:
    """Joints are behind or in front of the readings at their pixels; those without a
    reading do not count.
    """
    v, u = np.argwhere(image < 700)[200]
    surface, d = CAMERA.unproject([u, v, image[v, u]]), float(image[v, u])
    joints = np.stack([surface * (1 + dz / d) for dz in (12, -30, 500)])[None]
    found = IMAGES.joint_depths(joints, image, CAMERA)
    most = IMAGES.settings.max_joint_depth_mm
    assert found.behind[0] == pytest.approx((12 + most) / 3, rel=1e-4)
    assert found.before[0] == pytest.approx(10, rel=1e-4)
    missing = image.copy()
    missing[v, u] = np.nan
    for nothing in (missing, np.zeros_like(image)):
        assert [*np.ravel(IMAGES.joint_depths(joints, nothing, CAMERA))] == [0, 0]
