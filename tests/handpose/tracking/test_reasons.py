"""handpose/tracking/reasons.py: images without a detectable hand, each with its own reason"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.facts.cameras import Camera
from handpose.track_files.track import HIDDEN, LEFT
from handpose.tracking.pose_estimator import SearchRegion
from handpose.tracking.reasons import NO_HAND, reason
from tests.handpose.tracking.test_hand_track import estimate

CAMERA = Camera("small", 147.0, 147.0, 80.0, 60.0, 160, 120)


def why(depth: np.ndarray, u: float = 80, v: float = 60, d: float = 600, confidence: float | None = 0.2) -> str:
    """The reason for a hand that was expected at this place."""
    seen = None if confidence is None else estimate(confidence=confidence)
    return reason(depth.astype(np.float32), CAMERA, 300.0, SearchRegion(np.array([u, v, d]), "right"), seen)


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
)  # fmt: skip
def test_beyond_the_edges(u: float, v: float, where: str) -> None:
    """A hand beyond an edge of the image has left there."""
    assert why(wall(), u, v) == f"{LEFT} at the {where} edge"


def test_near_the_edges() -> None:
    """A hand half visible at an edge has left there, although its middle is in the image; a far one is smaller."""
    depth = wall()
    depth[40:80, 130:] = 600
    assert why(depth, 153) == f"{LEFT} at the right edge" and why(wall(), 143).startswith("only background")
    far = np.where(depth == 600, 1200, depth)
    assert why(far, 153, d=1200) == f"{LEFT} at the right edge" and why(far, 140, d=1200).startswith(NO_HAND)


def test_something_that_an_edge_cuts() -> None:
    """An object that an edge cuts, such as a wrist, means that the hand has left there.

    An object that ends before the edge, or that reaches another edge, does not."""
    depth = wall()
    depth[40:80, 130:] = 600
    assert why(depth, 143) == why(depth, 126) == f"{LEFT} at the right edge"
    assert why(depth, 122).startswith(NO_HAND)
    depth[:, 159] = 1500
    assert why(depth, 143).startswith(NO_HAND)
    assert why(np.where(np.arange(120)[:, None] > 70, 600.0, wall()), 80, 95) == f"{LEFT} at the lower edge"


def test_an_edge_where_nothing_was_read() -> None:
    """An edge without readings does not count as cutting the hand."""
    depth = wall(0)
    depth[30:90, 40:120] = 130
    assert why(depth, 80, d=130).startswith(NO_HAND)
    depth[30:90, 120:] = 130
    assert why(depth, 80, d=130) == f"{LEFT} at the right edge"


def test_an_empty_frame() -> None:
    """An empty frame gives that reason for any place."""
    assert why(wall(0)) == why(wall(0), -5) == "no depth in this frame"


def test_hidden() -> None:
    """A nearer plate hides the hand, and one at the hand's depth does not."""
    assert why(plate(300, 40)) == f"{HIDDEN} by a nearer object"
    assert not why(plate(600, 40)).startswith(HIDDEN)


def test_nothing_there() -> None:
    """Only the wall, or a speck, is visible at the place."""
    assert why(wall()) == "only background at its last position, 600 mm away"
    assert why(plate(600, 1), d=612.3) == "only background at its last position, 612 mm away"


def test_no_hand_there() -> None:
    """The reason contains the confidence."""
    assert why(plate(600)) == f"{NO_HAND} (confidence 20%)"


def test_at_the_camera() -> None:
    """Where no crop is possible, as behind the camera, the reason is that the hand has left the image."""
    assert why(wall(), d=-10, confidence=None) == LEFT
    assert why(plate(600), confidence=None) == why(plate(600), u=float("nan")) == LEFT
