r"""Poses smoothed over time by One Euro filters (Casiez, Roussel and Vogel, CHI 2012): steady at rest, quick in motion.

Angles and the palm's pose are filtered instead of joints, so that bones keep their length: the palm's position by the
speed of the point, its rotation by the angular speed, and every other variable by its own speed.

The filter is a low-pass filter of the first order whose cutoff frequency grows with the speed v of what it filters:

    x̂ ← x̂ + α (x − x̂)        α = 1 / (1 + τ / Δt)        τ = 1 / (2π f)        f = f_min + β |v̂|

with v̂ the speed of x, itself filtered with a fixed cutoff. At rest f_min determines the remaining jitter, in motion
β how far x̂ lags behind. Times are the source's, so that a frame that is missing is a longer Δt.

Jitter has a speed, too, which opens the filter for it, especially with a noisy sensor or a hardly visible limb. So |v̂|
counts only by how much it exceeds κ n̂, with n̂ the usual |Δx / Δt − v̂|: how far single speeds scatter about the
filtered one, as a running geometric mean, because one jump is not jitter; and κ n̂ up to a bound, because quick turns
scatter as well.

A finger that bends within one or two frames has stopped before its filtered speed has grown. So the cutoff also grows
with the gap between x and x̂, where it is larger than jitter is:

    f = f_min + β |v̂| + γ max(|x − x̂| − δ, 0)

With κ = 0 and γ = 0 this is the paper's filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from handpose.fit.body import WorldPose
from netlib.blob import Array

SCATTER_HZ = 0.3  # cutoff of the logarithm of n̂
NO_SPEED = 1e-6  # lower bound for the logarithm


@dataclass(frozen=True)
class Cutoff:
    """f_min in Hz, β in Hz per unit of speed, the cutoff in Hz of the speed, κ, the bound of κ n̂, γ in Hz per unit, and
    δ."""

    least: float
    slope: float
    speed: float
    noise: float = 0.0
    most: float = math.inf
    gap: float = 0.0
    least_gap: float = 0.0

    def hertz(self, speed: Array, scatter: Array, gap: Array, trust: float) -> Array:
        """The cutoff at a speed |v̂| with a scatter n̂ and a gap |x − x̂|, scaled by ``trust``.

        The part of the gap is scaled by its cube, because a doubtful pose may be far off.
        """
        known = np.maximum(speed - np.minimum(self.noise * scatter, self.most), 0.0)
        far = np.maximum(gap - self.least_gap, 0.0)
        return np.asarray(trust * (self.least + self.slope * known) + trust**3 * self.gap * far)


class _Kept(NamedTuple):
    """The state after the previous frame; the logarithm of the scatter."""

    time: float
    raw: Array
    filtered: Array
    speed: Array
    scatter: Array
    steps: int


def share(cutoff: Array | float, seconds: float) -> Array:
    """α, the weight of a new value, for a cutoff in Hz and the seconds since the last value."""
    return np.asarray(1 / (1 + 1 / (2 * np.pi * np.asarray(cutoff) * seconds)))


class OneEuro:
    """Filters vectors (n,): each element by its own speed, or all by the speed of the vector.

    together  use the vector's speed for all elements, for coordinates of a point
    """

    def __init__(self, cutoff: Cutoff, together: bool = False) -> None:
        self.cutoff, self.together = cutoff, together
        self._kept: _Kept | None = None

    def __call__(self, value: Array, time: float, trust: float = 1.0) -> Array:
        """The filtered value (n,) at a time in s; times ascend.

        trust  up to 1: factor of the cutoff
        """
        kept = self._kept
        if kept is None:
            self._kept = _Kept(time, value, value, self._still(value), np.zeros(()), 0)
            return value
        seconds = time - kept.time
        if seconds <= 0:
            return kept.filtered
        now = self._between(kept.raw, value) / seconds
        speed = kept.speed + share(self.cutoff.speed, seconds) * (now - kept.speed)
        scatter = np.log(np.maximum(self._size(now - speed), NO_SPEED))
        scatter = kept.scatter + max(share(SCATTER_HZ, seconds), 1 / (kept.steps + 1)) * (scatter - kept.scatter)
        gap = self._between(kept.filtered, value)
        part = share(self.cutoff.hertz(self._size(speed), np.exp(scatter), self._size(gap), trust), seconds)
        filtered = self._moved(kept.filtered, part * gap)
        self._kept = _Kept(time, value, filtered, speed, scatter, kept.steps + 1)
        return filtered

    def _size(self, way: Array) -> Array:
        return np.asarray(np.linalg.norm(way)) if self.together else np.abs(way)

    def _still(self, value: Array) -> Array:
        return np.zeros_like(value)

    def _between(self, first: Array, second: Array) -> Array:
        return second - first

    def _moved(self, value: Array, way: Array) -> Array:
        return value + way


class OneEuroRotation(OneEuro):
    """The same for rotations (3, 3): x − x̂ is the turn from one to the other, its speed in rad/s."""

    def __init__(self, cutoff: Cutoff) -> None:
        super().__init__(cutoff, together=True)

    def _still(self, value: Array) -> Array:
        return np.zeros(3)

    def _between(self, first: Array, second: Array) -> Array:
        return turn_between(first, second)

    def _moved(self, value: Array, way: Array) -> Array:
        return turned(value, way)


def turn_between(first: Array, second: Array) -> Array:
    """The turn (3,), its axis times its angle, that leads from one rotation (3, 3) to another, in the world's axes."""
    return np.asarray(cv2.Rodrigues(second @ first.T)[0]).reshape(3)


def turned(rotation: Array, turn: Array) -> Array:
    """A rotation (3, 3) turned further by a turn (3,)."""
    return np.asarray(cv2.Rodrigues(turn)[0]) @ rotation


# Chosen on synthetic movements with three cameras that are in no reported result; the gaps on the real hands P1, P4 and
# hpx, and on two synthetic recordings, whose jitter they raise by less than 2%.
PLACE = Cutoff(least=0.5, slope=0.4, speed=2.7, noise=1.3, most=25.0)  # per mm/s
ROTATION = Cutoff(least=0.8, slope=45.0, speed=4.0, noise=2.1, most=0.5, gap=200.0, least_gap=0.03)  # per rad/s, rad
# the same, and of sizes their logarithm
OTHERS = Cutoff(least=0.8, slope=15.0, speed=0.75, noise=1.05, most=0.4, gap=150.0, least_gap=0.06)
GOOD_MM = 30.0  # expected error of a pose above which it is trusted less; smaller errors last, so smoothing only delays
POWER = 3  # exponent of the ratio of the errors
MIN_TRUST = 0.1  # minimum trust, because a hand may move meanwhile


class PoseFilter:
    """Smooths the poses of one body."""

    def __init__(self) -> None:
        self._place = OneEuro(PLACE, together=True)
        self._rotation = OneEuroRotation(ROTATION)
        self._others = OneEuro(OTHERS)

    def __call__(self, body: WorldPose, time: float, error_mm: float = math.nan) -> WorldPose:
        """The smoothed body at a time in s; times ascend.

        error_mm  expected error of its joints; NaN if unknown
        """
        trust = 1.0 if math.isnan(error_mm) else max((GOOD_MM / max(error_mm, GOOD_MM)) ** POWER, MIN_TRUST)
        return WorldPose(
            self._place(body.place, time, trust),
            self._rotation(body.rotation, time, trust),
            self._others(body.others, time, trust),
        )
