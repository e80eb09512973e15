"""Depth frames in which a part of a hand is outside the image, covered, or not read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera
from netlib.blob import Array
from netlib.errors import DataError

# Largest shares of a hand: of its joints outside the image, of its pixels covered or not read.
MAX_OUTSIDE, MAX_HIDDEN = 0.6, 0.9
NEARER = (0.5, 0.9)  # range of the depth of what covers a hand, relative to the hand's
REACH_MM, DEPTH_MM = 120.0, 150.0  # of a hand's pixels from the middle of its joints


class Shown(NamedTuple):
    """A depth frame (height, width) in mm, and its camera."""

    depth: NDArray[np.float32]
    camera: Camera


class _Part(NamedTuple):
    """A part on one side of a hand: its first or last columns (axis 0) or rows (axis 1), as many as
    contain ``share`` of its pixels.
    """

    axis: int
    is_first: bool
    share: float

    @classmethod
    def drawn(cls, rng: np.random.Generator, most: float) -> _Part:
        """A part of any side, with a share of up to ``most``."""
        axis, first = rng.integers(2, size=2)
        return cls(int(axis), bool(first), rng.uniform(0.05, most))

    def edge(self, pixels: Array) -> int:
        """The column or row of its edge, for a hand with these pixels (P, 2)."""
        share = self.share if self.is_first else 1 - self.share
        return round(float(np.quantile(pixels[:, self.axis], share)))


def hidden_parts(rng: np.random.Generator, shown: Shown, joints: Array) -> Iterator[Shown]:
    """The frame with a part of the hand with these joints (K, 3) in mm, camera axes, outside the
    image, then covered, and then not read.

    Raises DataError if no reading is of the hand.
    """
    yield _cut(shown, joints, _Part.drawn(rng, MAX_OUTSIDE))
    for nearer in (rng.uniform(*NEARER), 0.0):
        yield _covered(shown, joints, _Part.drawn(rng, MAX_HIDDEN), nearer)


def _cut(shown: Shown, joints: Array, part: _Part) -> Shown:
    """The frame that ends at the edge of a part."""
    depth, camera = shown
    edge = max(part.edge(camera.project(joints)[:, :2]), 1)
    kept = slice(edge, None) if part.is_first else slice(edge)
    depth = depth[:, kept] if part.axis == 0 else depth[kept]
    u0, v0 = camera.u0, camera.v0
    if part.is_first:
        u0, v0 = (u0 - edge, v0) if part.axis == 0 else (u0, v0 - edge)
    height, width = depth.shape
    return Shown(depth, replace(camera, u0=u0, v0=v0, width=width, height=height))


def _covered(shown: Shown, joints: Array, part: _Part, nearer: float) -> Shown:
    """The frame with readings at this depth, relative to the hand's, in place of a part.

    Raises DataError if no reading is of the hand.
    """
    depth, camera = shown
    u, v, d = camera.project(joints.mean(axis=0))
    rows, columns = np.indices(depth.shape)
    reach = REACH_MM * camera.fx / d
    is_near = (np.abs(columns - u) < reach) & (np.abs(rows - v) < reach)
    is_hand = is_near & (np.abs(depth - d) < DEPTH_MM)
    if not is_hand.any():
        raise DataError(f"no reading of the hand at {d:.0f} mm; expected some, to hide a part")
    at = (columns, rows)[part.axis]
    edge = part.edge(np.argwhere(is_hand)[:, ::-1])
    is_part = is_hand & ((at < edge) if part.is_first else (at > edge))
    return Shown(np.where(is_part, np.float32(nearer * d), depth), camera)
