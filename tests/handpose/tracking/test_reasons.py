"""handpose/tracking/reasons.py: images without a detectable hand, each with its own reason"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.fit.support import Support
from handpose.frames.cameras import Camera
from handpose.tracking.reasons import NO_HAND, reason
from handpose.tracking.track import HIDDEN, LEFT

CAMERA = Camera("small", 147.0, 147.0, 80.0, 60.0, 160, 120)
OFFSETS = np.array(
    [(x, y, z) for x in (-60, 0, 60) for y in (-60, 0, 60) for z in (-20, 20)], float
)
WALL = np.full((120, 160), 1500)
COVERED, UNLIKE = f"{HIDDEN} by a nearer object", f"{NO_HAND} (confidence 20%)"


def why(
    depth: np.ndarray,
    u: float = 80,
    v: float = 60,
    d: float = 600,
    *,
    hidden: float = 0.0,
    missing: float = 0.0,
    outside: float = 0.0,
) -> str:
    """The reason for a hand 120 mm wide that was expected at this place, with these shares
    of its surface.
    """
    shares = Support(
        *(
            np.array([one])
            for one in (1 - hidden - missing - outside, hidden, 0.0, missing, outside)
        )
    )
    xyz = CAMERA.unproject(np.array([u, v, d])) + OFFSETS
    return reason(depth.astype(np.float32), CAMERA, xyz, np.array([u, v, d]), 300.0, shares, 0.2)


def plate(mm: float, half: int = 20) -> np.ndarray:
    """A depth image of a plate in front of a wall."""
    depth = WALL.copy()
    depth[60 - half : 60 + half, 80 - half : 80 + half] = mm
    return depth


@pytest.mark.parametrize(
    ("u", "v", "where"),
    [
        (-5, 60, "left"),
        (165, 60, "right"),
        (80, -9, "upper"),
        (80, 125, "lower"),
        (-5, 125, "left lower"),
        (900, -900, "right upper"),
    ],
)
def test_beyond_the_edges(u: float, v: float, where: str) -> None:
    """A hand beyond an edge of the image has left there."""
    assert why(WALL, u, v) == f"{LEFT} at the {where} edge"


def test_only_the_hand_itself_leaves() -> None:
    """A hand has not left while an edge cuts only its forearm; with a third of its joints
    outside it has.
    """
    depth = WALL.copy()
    depth[40:, 60:100] = 600
    assert why(depth, 80, 90) == UNLIKE
    assert why(depth, 80, 108) == f"{LEFT} at the lower edge"
    # Of a hand of which a few joints are outside, and that is not found, what is not read may
    # be outside, too.
    assert [why(depth, 80, 104.5, missing=0.5, outside=share) for share in (0.04, 0.1)] == [
        "no depth at its last position, 600 mm away",
        f"{LEFT} at the lower edge",
    ]


@pytest.mark.parametrize(
    ("depth", "place", "expected"),
    [
        (0 * WALL, {}, "no depth in this frame"),  # wherever the hand was
        (0 * WALL, {"u": -5}, "no depth in this frame"),
        (WALL, {"d": -10}, LEFT),  # behind the camera, where no crop is possible
        (plate(30, 40), {}, COVERED),  # in front of the hand's cube
        (plate(300, 40), {}, COVERED),
        (plate(560, 40), {"hidden": 0.5}, COVERED),  # within it
        (plate(600, 40), {}, UNLIKE),
        (plate(600), {}, UNLIKE),
        (WALL, {}, "only background at its last position, 600 mm away"),
        (plate(600, 1), {"d": 612.3}, "only background at its last position, 612 mm away"),
        (plate(600), {"missing": 0.7}, "no depth at its last position, 600 mm away"),
    ],
)
def test_the_reason_follows_from_the_depth_at_the_place_of_the_hand(
    depth: np.ndarray, place: dict[str, float], expected: str
) -> None:
    assert why(depth, **place) == expected
