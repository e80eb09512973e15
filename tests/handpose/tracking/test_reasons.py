"""handpose/tracking/reasons.py: images without a detectable hand, each with its own reason"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.fit.support import Support
from handpose.frames.cameras import Camera
from handpose.tracking.reasons import NO_HAND, reason
from handpose.tracking.track import HIDDEN, LEFT

CAMERA = Camera("small", 147.0, 147.0, 80.0, 60.0, 160, 120)
OFFSETS = np.array([(x, y, z) for x in (-60, 0, 60) for y in (-60, 0, 60) for z in (-20, 20)], float)


def why(
    depth: np.ndarray, u: float = 80, v: float = 60, d: float = 600, *, hidden: float = 0.0, missing: float = 0.0
) -> str:
    """The reason for a hand 120 mm wide that was expected at this place."""
    shares = Support(*(np.array([one]) for one in (1 - hidden - missing, hidden, 0.0, missing, 0.0)))
    xyz = CAMERA.unproject(np.array([u, v, d])) + OFFSETS
    return reason(depth.astype(np.float32), CAMERA, xyz, np.array([u, v, d]), 300.0, shares, 0.2)


def wall(mm: float = 1500) -> np.ndarray:
    """A depth image of a wall."""
    return np.full((120, 160), mm)


def plate(mm: float, half: int = 20) -> np.ndarray:
    """A depth image of a plate in front of a wall."""
    depth = wall()
    depth[60 - half : 60 + half, 80 - half : 80 + half] = mm
    return depth


@pytest.mark.parametrize(
    ("u", "v", "where"),
    [(-5, 60, "left"), (165, 60, "right"), (80, -9, "upper"), (80, 125, "lower"), (-5, 125, "left lower"),
     (900, -900, "right upper")],
)
def test_beyond_the_edges(u: float, v: float, where: str) -> None:
    """A hand beyond an edge of the image has left there."""
    assert why(wall(), u, v) == f"{LEFT} at the {where} edge"


def test_only_the_hand_itself_leaves() -> None:
    """A hand has not left while an edge cuts only its forearm; with a third of its joints outside it has."""
    depth = wall()
    depth[40:, 60:100] = 600
    assert why(depth, 80, 90).startswith(NO_HAND)
    assert why(depth, 80, 108) == f"{LEFT} at the lower edge"


def test_an_empty_frame() -> None:
    """An empty frame gives that reason for any place."""
    assert why(wall(0)) == why(wall(0), -5) == "no depth in this frame"


def test_hidden() -> None:
    """A nearer plate hides the hand, whether in front of its cube or within it; one at the hand's depth does not."""
    for near in (30, 300):
        assert why(plate(near, 40)) == f"{HIDDEN} by a nearer object"
    assert why(plate(560, 40), hidden=0.5) == f"{HIDDEN} by a nearer object"
    assert not why(plate(600, 40)).startswith(HIDDEN)


def test_nothing_there() -> None:
    """Only the wall, or a speck, is visible at the place; or nothing was read there."""
    assert why(wall()) == "only background at its last position, 600 mm away"
    assert why(plate(600, 1), d=612.3) == "only background at its last position, 612 mm away"
    assert why(plate(600), missing=0.7) == "no depth at its last position, 600 mm away"


def test_no_hand_there() -> None:
    assert why(plate(600)) == f"{NO_HAND} (confidence 20%)"


def test_behind_the_camera() -> None:
    """Where no crop is possible, the hand has left the image."""
    assert why(wall(), d=-10) == LEFT
