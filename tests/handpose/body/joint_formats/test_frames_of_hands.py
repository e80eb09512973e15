"""handpose/body/joint_formats/frames.py"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from posed_hands import MIRROR, PEOPLE, any_pose, right_hand

from handpose.body.joint_formats.frames import (
    LONG_FINGERS,
    POINTS,
    SKIN,
    hinges_of,
    palm_frame,
    weights_of,
)
from layers.hand.skeleton import NYU_HAND, Skeleton, load
from netlib.errors import DataError

PARTS = ("pip_a", "pip_b", "dip", "tip")  # of a finger beyond its base


@pytest.mark.parametrize("skeleton", [PEOPLE, load()], ids=["people", "nyu"])
def test_weights_sum_to_one(skeleton: Skeleton) -> None:
    """The weights of every point sum to 1, so that points move, rotate, scale and mirror
    with the hand.
    """
    weights = weights_of(list(POINTS.values()), skeleton)
    assert np.allclose(weights.sum(axis=1), 1)


@pytest.mark.parametrize(
    ("skeleton", "bends_at"),
    [(PEOPLE, ("mcp", "pip_a", "dip", "tip")), (load(), ("mcp", "base", "pip_b", "tip"))],
    ids=["people", "nyu"],
)
def test_a_finger_bends_at_three_joints(skeleton: Skeleton, bends_at: tuple[str, ...]) -> None:
    """The hinges are the joints about which a finger's angles turn; the packaged hand's are the
    anatomical joints.
    """
    hinges = hinges_of(skeleton)
    for finger in LONG_FINGERS:
        assert [skeleton.joint_names[joint] for joint in hinges[finger]] == [
            f"{finger}_{part}" for part in bends_at
        ]
        own = [POINTS[f"{finger}_{part}"].weights for part in ("mcp", "pip", "dip", "tip")]
        assert skeleton is not PEOPLE or own == [{f"{finger}_{part}": 1} for part in bends_at]
    assert [skeleton.joint_names[joint] for joint in hinges["thumb"]] == [
        f"thumb_{part}" for part in ("mcp", "pip", "dip", "tip")
    ]


@pytest.mark.parametrize(
    ("angle", "now"),
    [("index_dip_rot_x", "fixed: true"), ("little_mcp_rot_x", "lower: -0.1 upper: 0.1")],
)
def test_a_joint_that_cannot_bend(tmp_path: Path, angle: str, now: str) -> None:
    """Fixed angles of a finger are hinges, too, and free ones of a metacarpal are none."""
    text = NYU_HAND.with_name("people.prototxt").read_text()
    text, changes = re.subn(rf'(dof {{ name: "{angle}".*initial: \S+).*}}', rf"\1 {now} }}", text)
    (tmp_path / "changed.prototxt").write_text(text)
    assert changes == 1 and hinges_of(load(tmp_path / "changed.prototxt")) == hinges_of(PEOPLE)


def test_phalanges_of_people() -> None:
    """Phalanges have the proportions measured by Buryanov and Kotiuk, 2010; the last one
    without 3.8 mm.
    """
    measured = {
        "index": (39.8, 22.4, 15.8),
        "middle": (44.6, 26.3, 17.4),
        "ring": (41.4, 25.7, 17.3),
    }
    measured["little"] = (32.7, 18.1, 16.0)
    for finger, lengths in measured.items():
        of = [
            PEOPLE.bones[PEOPLE.joint_names.index(f"{finger}_{part}")] for part in ("base", *PARTS)
        ]
        ratios = (
            np.array([of[0] + of[1], of[2] + of[3], of[4]])
            * 150
            / (lengths - np.array([0, 0, 3.8]))
        )
        assert ratios == pytest.approx(ratios[0], abs=1e-3) and 1.15 < ratios[0] < 1.3


def test_the_skin_is_a_radius_beyond_the_last_joint() -> None:
    """The packaged numbers are the skeleton file's radius at the tip, relative to the last bone."""
    surface = PEOPLE.param.flesh
    assert surface is not None
    for finger, part in SKIN.items():
        last = next(capsule for capsule in surface.capsule if capsule.to == f"{finger}_tip")
        bone = PEOPLE.bones[PEOPLE.joint_names.index(f"{finger}_tip")]
        assert part == pytest.approx(last.radius[-1] / bone, abs=0.01)


def test_a_body_without_fingers_is_rejected() -> None:
    """The error names the joint that the body lacks."""
    arm = load(NYU_HAND.parents[1] / "body" / "arm.prototxt")
    with pytest.raises(DataError, match=r"no joint 'thumb_mcp'; only hands"):
        weights_of(list(POINTS.values()), arm)


def test_the_palm_of_a_mirror_image() -> None:
    """The best rotation is a rotation, with determinant 1, also for a left hand, which no
    rotation moves there.
    """
    for mirror in (np.ones(3), MIRROR):
        R = palm_frame(right_hand(any_pose(np.random.default_rng(0))) * mirror, PEOPLE)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) > 0
