"""handpose/body/model.py: Fingers"""

from __future__ import annotations

import numpy as np

from handpose.body.model import FINGERS, Fingers, has_fingers
from handpose.fit.body import CapsuleModel
from layers.hand import skeleton
from tests.support.made_tracks import any_skeleton


def test_the_joints_of_each_finger(model: CapsuleModel) -> None:
    """Three points of each finger: the middle of its two points at the PIP joint, the DIP joint and the tip."""
    names = model.skeleton.joint_names
    joints = np.random.default_rng(0).normal(size=(2, len(names), 3))
    found = Fingers(model.surface).joints(joints)
    assert found.shape == (2, 5, 3, 3)
    a, b = (joints[1, names.index(f"ring_pip_{end}")] for end in "ab")
    np.testing.assert_allclose(found[1, FINGERS.index("ring"), 0], (a + b) / 2)
    for row, point in enumerate(("thumb_pip", "thumb_dip", "thumb_tip")):
        np.testing.assert_allclose(found[0, 0, row], joints[0, names.index(point)])


def test_the_surface_of_each_finger(model: CapsuleModel) -> None:
    """Every finger has capsules, to its tip; none belongs to two fingers or to the arm."""
    surface = model.surface
    capsules = Fingers(surface).capsules
    assert capsules.sum(axis=0).max() == 1 and not (capsules & surface.limbs).any()
    for finger, own in zip(FINGERS, capsules, strict=True):
        assert model.skeleton.joint_names.index(f"{finger}_tip") in surface.end[own]


def test_bodies_without_fingers() -> None:
    assert has_fingers(skeleton.load()) and not has_fingers(any_skeleton(1))
