r"""Poses smoothed over time by One Euro filters (Casiez, Roussel and Vogel, CHI 2012): steady at
rest, quick in motion.

Angles and the palm's pose are filtered instead of joints, so that bones keep their length:
the palm's position by the speed of the point, its rotation by the angular speed, and every
other variable by its own speed. A difference of poses is a step (``WorldPose``), and a speed
a step per second.

The filter is a low-pass filter of the first order whose cutoff frequency grows with the speed v of
what it filters:

    x̂ ← x̂ + α (x − x̂)        α = 1 / (1 + τ / Δt)        τ = 1 / (2π f)        f = f_min + β |v̂|

with v̂ the speed of x, itself filtered with a fixed cutoff. At rest f_min determines the remaining
jitter, in motion β how far x̂ lags behind. Times are the source's, so that a frame that is missing
is a longer Δt.

Jitter has a speed, too, which opens the filter for it, especially with a noisy sensor or a hardly
visible limb. So |v̂| counts only by how much it exceeds κ n̂, with n̂ the usual |Δx / Δt − v̂|: how
far single speeds scatter about the filtered one, as a running geometric mean, because one jump is
not jitter; and κ n̂ up to a bound, because quick turns scatter as well.

A finger that bends within one or two frames has stopped before its filtered speed has grown. So the
cutoff also grows with the gap between x and x̂, where it is larger than jitter is:

    f = f_min + β |v̂| + γ max(|x − x̂| − δ, 0)

With κ = 0 and γ = 0 this is the paper's filter. A pose whose expected error is above ``GOOD_MM`` is
trusted less; smaller errors last, so smoothing only delays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from handpose.fit.body import WorldPose
from handpose.fit.pose_confidence import GOOD_MM
from handpose.tracking.settings import Cutoff, SmoothSettings
from netlib.blob import Array

NO_SPEED = 1e-6  # lower bound for the logarithm of a scatter


class _Kept(NamedTuple):
    """The state after the previous frame, the ``number``-th: v̂ (V,), and the
    logarithm of n̂ (V,).
    """

    time: float
    raw: WorldPose
    filtered: WorldPose
    speed: Array
    scatter: Array
    number: int


class PoseFilter:
    """Smooths the poses of one body."""

    def __init__(self, settings: SmoothSettings) -> None:
        self._settings = settings
        self._kept: _Kept | None = None

    def __call__(self, body: WorldPose, time: float, error_mm: float = math.nan) -> WorldPose:
        """The smoothed body at a time in s; times ascend.

        error_mm  expected error of its joints; NaN if unknown
        """
        kept = self._kept
        if kept is None:
            still = np.zeros(6 + len(body.others))
            self._kept = _Kept(time, body, body, still, still, 1)
            return body
        seconds = time - kept.time
        if seconds <= 0:
            return kept.filtered
        cutoff = self._cutoff_of(body)
        now = kept.raw.step_to(body) / seconds
        speed = kept.speed + share(cutoff.speed_hz, seconds) * (now - kept.speed)
        scatter = self._scatter(kept, now - speed, seconds)
        gap = kept.filtered.step_to(body)
        trust = self._trust(error_mm)
        hertz = _hertz(cutoff, _sizes(speed), np.exp(scatter), _sizes(gap), trust)
        filtered = kept.filtered.moved(share(hertz, seconds) * gap)
        self._kept = _Kept(time, body, filtered, speed, scatter, kept.number + 1)
        return filtered

    def _cutoff_of(self, body: WorldPose) -> Cutoff:
        """The settings of each variable of a body, (V,) each."""
        s = self._settings
        counts = (3, 3, len(body.others))
        return Cutoff(*np.repeat((s.place, s.rotation, s.others), counts, axis=0).T)

    def _scatter(self, kept: _Kept, deviation: Array, seconds: float) -> Array:
        """The logarithm (V,) of n̂ after a deviation (V,) of the speed from the filtered one.

        At first it is the mean of all deviations so far.
        """
        now = np.log(np.maximum(_sizes(deviation), NO_SPEED))
        weight = max(share(self._settings.scatter_hz, seconds), 1 / kept.number)
        return np.asarray(kept.scatter + weight * (now - kept.scatter))

    def _trust(self, error_mm: float) -> float:
        """The factor of the cutoffs for a pose with an expected error; 1 if it is unknown."""
        if math.isnan(error_mm):
            return 1.0
        s = self._settings
        return max((GOOD_MM / max(error_mm, GOOD_MM)) ** s.power, s.min_trust)


def _hertz(c: Cutoff, speed: Array, scatter: Array, gap: Array, trust: float) -> Array:
    """The cutoffs (V,) at speeds |v̂| with a scatter n̂ and gaps |x − x̂|, scaled by ``trust``.

    The part of the gap is scaled by its cube, because a doubtful pose may be far off.
    """
    known = np.maximum(speed - np.minimum(c.noise * scatter, c.max_noise), 0.0)
    far = np.maximum(gap - c.min_gap, 0.0)
    by_speed = c.min_hz + c.slope * known
    return trust * by_speed + trust**3 * c.gap_slope * far


def share(cutoff: Array | float, seconds: float) -> Array:
    """α, the weight of a new value, for a cutoff in Hz and the seconds since the last value."""
    radians = 2 * np.pi * np.asarray(cutoff) * seconds
    return 1 / (1 + 1 / radians)


def _sizes(step: Array) -> Array:
    """The size (V,) of each variable of a step: of the place's and the turn's three, the length
    of the vector.
    """
    sizes = np.abs(step)
    sizes[:3] = np.linalg.norm(step[:3])
    sizes[3:6] = np.linalg.norm(step[3:6])
    return sizes
