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

With κ = 0 and γ = 0 this is the paper's filter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from handpose.fit.body import WorldPose
from netlib.blob import Array

SCATTER_HZ = 0.3  # cutoff of the logarithm of n̂
NO_SPEED = 1e-6  # lower bound for the logarithm


class Cutoff(NamedTuple):
    """f_min in Hz, β in Hz per unit of speed, the cutoff in Hz of the speed, κ, the bound of κ n̂,
    γ in Hz per unit, and δ.
    """

    least: float
    slope: float
    speed: float
    noise: float = 0.0
    most: float = math.inf
    gap: float = 0.0
    least_gap: float = 0.0


# Chosen on synthetic movements with three cameras that are in no reported result; the gaps
# on the real hands P1, P4 and hpx, and on two synthetic recordings, whose jitter they raise
# by less than 2%.
PLACE = Cutoff(least=0.5, slope=0.4, speed=2.7, noise=1.3, most=25.0)  # per mm/s
# per rad/s, rad
ROTATION = Cutoff(least=0.8, slope=45.0, speed=4.0, noise=2.1, most=0.5, gap=200.0, least_gap=0.03)
# the same, and of sizes their logarithm
OTHERS = Cutoff(least=0.8, slope=15.0, speed=0.75, noise=1.05, most=0.4, gap=150.0, least_gap=0.06)
# expected error of a pose above which it is trusted less; smaller errors last, so
# smoothing only delays
TRUSTED_MM = 30.0
POWER = 3  # exponent of the ratio of the errors
MIN_TRUST = 0.1  # minimum trust, because a hand may move meanwhile


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
    """Smooths the poses of one body.

    cutoffs  of the place, the rotation, and each of the other variables
    """

    def __init__(self, cutoffs: tuple[Cutoff, Cutoff, Cutoff] = (PLACE, ROTATION, OTHERS)) -> None:
        self._cutoffs = cutoffs
        self._kept: _Kept | None = None

    def __call__(self, body: WorldPose, time: float, error_mm: float = math.nan) -> WorldPose:
        """The smoothed body at a time in s; times ascend.

        error_mm  expected error of its joints; NaN if unknown
        """
        kept = self._kept
        if kept is None:
            still = np.zeros(6 + len(body.others))
            self._kept = _Kept(time, body, body, still, still, 1)
            # (V,) each
            self._each = Cutoff(
                *np.repeat(np.array(self._cutoffs), (3, 3, len(body.others)), axis=0).T
            )
            return body
        seconds = time - kept.time
        if seconds <= 0:
            return kept.filtered
        trust = (
            1.0
            if math.isnan(error_mm)
            else max((TRUSTED_MM / max(error_mm, TRUSTED_MM)) ** POWER, MIN_TRUST)
        )
        now = kept.raw.step_to(body) / seconds
        speed = kept.speed + share(self._each.speed, seconds) * (now - kept.speed)
        scatter = np.log(np.maximum(_sizes(now - speed), NO_SPEED))
        scatter = kept.scatter + max(share(SCATTER_HZ, seconds), 1 / kept.number) * (
            scatter - kept.scatter
        )
        gap = kept.filtered.step_to(body)
        hertz = self._hertz(_sizes(speed), np.exp(scatter), _sizes(gap), trust)
        filtered = kept.filtered.moved(share(hertz, seconds) * gap)
        self._kept = _Kept(time, body, filtered, speed, scatter, kept.number + 1)
        return filtered

    def _hertz(self, speed: Array, scatter: Array, gap: Array, trust: float) -> Array:
        """The cutoffs (V,) at speeds |v̂| with a scatter n̂ and gaps |x − x̂|, scaled by ``trust``.

        The part of the gap is scaled by its cube, because a doubtful pose may be far off.
        """
        c = self._each
        known = np.maximum(speed - np.minimum(c.noise * scatter, c.most), 0.0)
        far = np.maximum(gap - c.least_gap, 0.0)
        return np.asarray(trust * (c.least + c.slope * known) + trust**3 * c.gap * far)


def share(cutoff: Array | float, seconds: float) -> Array:
    """α, the weight of a new value, for a cutoff in Hz and the seconds since the last value."""
    return np.asarray(1 / (1 + 1 / (2 * np.pi * np.asarray(cutoff) * seconds)))


def _sizes(step: Array) -> Array:
    """The size (V,) of each variable of a step: of the place's and the turn's three, the length
    of the vector.
    """
    sizes = np.abs(step)
    sizes[:3], sizes[3:6] = np.linalg.norm(step[:3]), np.linalg.norm(step[3:6])
    return np.asarray(sizes)
