r"""The One Euro filter (Casiez, Roussel and Vogel, CHI 2012): steady at rest, quick in motion.

A low-pass filter of the first order whose cutoff frequency grows with the speed v of what it filters:

    x̂ ← x̂ + α (x − x̂)        α = 1 / (1 + τ / Δt)        τ = 1 / (2π f)        f = f_min + β |v̂|

with v̂ the speed of x, itself filtered with a fixed cutoff. At rest f_min decides how much trembling is left, in motion
β how far x̂ lags behind. Times are the source's, so that a frame that is missing is a longer Δt.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from netlib.blob import Array


@dataclass(frozen=True)
class Cutoff:
    """f_min in Hz, β in Hz per unit of speed, and the cutoff in Hz of the speed."""

    least: float
    slope: float
    speed: float


def share(cutoff: Array | float, seconds: float) -> Array:
    """α, how much of a new value counts, with a cutoff in Hz and so many seconds since the last one."""
    return np.asarray(1 / (1 + 1 / (2 * np.pi * np.asarray(cutoff) * seconds)))


class OneEuro:
    """Filters vectors (n,): each element by its own speed, or all by that of the vector.

    together  one speed, the vector's length, for all elements: where they are coordinates of a point
    """

    def __init__(self, cutoff: Cutoff, together: bool = False) -> None:
        self.cutoff, self.together = cutoff, together
        self._last: tuple[float, Array, Array, Array] | None = None  # time, raw, filtered, speed

    def __call__(self, value: Array, time: float) -> Array:
        """The filtered value (n,) at a time in s; times ascend."""
        if self._last is None:
            self._last = time, value, value, np.zeros_like(value)
            return value
        before, raw, filtered, speed = self._last
        seconds = time - before
        if seconds <= 0:
            return filtered
        speed = speed + share(self.cutoff.speed, seconds) * ((value - raw) / seconds - speed)
        size = np.linalg.norm(speed) if self.together else np.abs(speed)
        filtered = filtered + share(self.cutoff.least + self.cutoff.slope * size, seconds) * (value - filtered)
        self._last = time, value, filtered, speed
        return filtered


class OneEuroRotation:
    """The same for rotations (3, 3): x − x̂ is the turn from one to the other, its speed in rad/s."""

    def __init__(self, cutoff: Cutoff) -> None:
        self.cutoff = cutoff
        self._last: tuple[float, Array, Array, Array] | None = None

    def __call__(self, value: Array, time: float) -> Array:
        """The filtered rotation at a time in s; times ascend."""
        if self._last is None:
            self._last = time, value, value, np.zeros(3)
            return value
        before, raw, filtered, speed = self._last
        seconds = time - before
        if seconds <= 0:
            return filtered
        speed = speed + share(self.cutoff.speed, seconds) * (turn_between(raw, value) / seconds - speed)
        part = share(self.cutoff.least + self.cutoff.slope * np.linalg.norm(speed), seconds)
        filtered = turned(filtered, part * turn_between(filtered, value))
        self._last = time, value, filtered, speed
        return filtered


def turn_between(first: Array, second: Array) -> Array:
    """The turn (3,), its axis times its angle, that leads from one rotation (3, 3) to another, in the world's axes."""
    return np.asarray(cv2.Rodrigues(second @ first.T)[0]).reshape(3)


def turned(rotation: Array, turn: Array) -> Array:
    """A rotation (3, 3) turned further by a turn (3,)."""
    return np.asarray(cv2.Rodrigues(turn)[0]) @ rotation
