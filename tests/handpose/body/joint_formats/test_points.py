"""handpose/body/joint_formats/points.py"""

from __future__ import annotations

import numpy as np
import pytest
from posed_hands import PEOPLE, any_pose, right_hand

from handpose.body.joint_formats.points import FINGERS, POINTS, SKIN, weights_of
from layers.hand.skeleton import NYU_HAND, load
from netlib.errors import DataError


def test_weights_sum_to_one() -> None:
    """The weights of every point sum to 1, so that points move, rotate, scale and mirror with the hand."""
    weights = weights_of(list(POINTS.values()), PEOPLE.joint_names)
    assert np.allclose(weights.sum(axis=1), 1)


def test_the_joints_of_a_finger_follow_each_other() -> None:
    """The joints run from the wrist to the tip, at plausible distances."""
    joints = right_hand(any_pose(np.random.default_rng(1)))
    for finger in FINGERS:
        cmc, mcp, pip, dip, tip, skin = (
            weights_of([POINTS[f"{finger}_{part}"]], PEOPLE.joint_names)[0] @ joints
            for part in ("cmc", "mcp", "pip", "dip", "tip", "skin")
        )
        lengths = [float(np.linalg.norm(b - a)) for a, b in ((cmc, mcp), (mcp, pip), (pip, dip), (dip, tip))]
        assert lengths[0] > lengths[1] > lengths[3] > 5
        assert 0 < np.linalg.norm(skin - tip) < 12


def test_the_skin_is_a_radius_beyond_the_last_joint() -> None:
    """The packaged numbers are the skeleton file's radius at the tip, relative to the last bone."""
    surface = PEOPLE.param.flesh
    assert surface is not None
    for finger, part in SKIN.items():
        last = next(capsule for capsule in surface.capsule if capsule.to == f"{finger}_tip")
        assert part == pytest.approx(
            last.radius[-1] / PEOPLE.bones[PEOPLE.joint_names.index(f"{finger}_tip")], abs=0.01
        )


def test_another_body_has_none() -> None:
    """The error names the joint that another body lacks."""
    arm = load(NYU_HAND.parents[1] / "body" / "arm.prototxt")
    with pytest.raises(DataError, match=r"no joint 'wrist_left'; only hands"):
        weights_of(list(POINTS.values()), arm.joint_names)
