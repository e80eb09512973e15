"""Exercise: the layer PhysLimit, a loss on angles beyond their limits."""

from __future__ import annotations

import numpy as np

from exercises import hand
from exercises.exercise import known_in
from exercises.layer_examples import Example, Letters
from exercises.layers import layer_exercise
from layers.hand.phys_limit import PhysLimit
from netlib.blob import Array, Blobs


class _Forward(PhysLimit):
    """forward split into methods; each subclass breaks one."""

    def beyond_of(self, x: Array) -> Array:
        return np.asarray(np.maximum(x - self.upper, 0) - np.maximum(self.lower - x, 0))

    def total(self, v: Array) -> float:
        return float(v.sum() if self.param.norm == "L1" else np.vdot(v, v))

    def count(self, x: Array) -> int:
        return len(x)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data.reshape(-1, len(self.lower))
        self.beyond = self.beyond_of(x)
        top[0].data[...] = self.total(np.abs(self.beyond)) / self.count(x)


class SquaresAlways(_Forward):
    """v is always squared. With norm L1, the paper's and the default, the loss is the sum of v itself."""

    def total(self, v: Array) -> float:
        return float(np.vdot(v, v))


class SquaresNever(_Forward):
    """v is never squared. With norm L2, the released system's, the loss is the sum of v²."""

    def total(self, v: Array) -> float:
        return float(v.sum())


class UpperOnly(_Forward):
    """An angle below its lower limit is also out of limits: v = max(lower - x, 0) + max(x - upper, 0)."""

    def beyond_of(self, x: Array) -> Array:
        return np.asarray(np.maximum(x - self.upper, 0))


class Cancels(_Forward):
    """Violations of lower limits are subtracted from those of upper limits. v counts both as positive."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data.reshape(-1, len(self.lower))
        self.beyond = self.beyond_of(x)
        total = self.beyond.sum() if self.param.norm == "L1" else np.vdot(self.beyond, self.beyond)
        top[0].data[...] = total / len(x)


class NotDivided(_Forward):
    """The sum is not divided by the number of poses N."""

    def count(self, x: Array) -> int:
        return 1


class MeanOfDofs(_Forward):
    """The sum is divided by the number of angles. Average over the poses only: 1 / N."""

    def count(self, x: Array) -> int:
        return x.size


class Halved(_Forward):
    """The squares have no factor 1/2, unlike in EuclideanLoss."""

    def total(self, v: Array) -> float:
        return float(v.sum() if self.param.norm == "L1" else np.vdot(v, v) / 2)


class MeanOfViolations(_Forward):
    """The sum is divided by the number of angles out of limits. Average over the poses: 1 / N."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        top[0].data[...] *= len(self.beyond) / max(int(np.count_nonzero(self.beyond)), 1)


class SquareOfSum(_Forward):
    """The sum of a pose's v is squared. With norm L2 each v is squared before summing."""

    def total(self, v: Array) -> float:
        return float(v.sum() if self.param.norm == "L1" else (v.sum(axis=1) ** 2).sum())


class SquareOfWholeSum(_Forward):
    """The sum over all poses is squared. With norm L2 each v is squared before summing."""

    def total(self, v: Array) -> float:
        return float(v.sum() if self.param.norm == "L1" else v.sum() ** 2)


class Degrees(_Forward):
    """v is in degrees. The angles, their limits and the loss are in radians: no conversion is needed."""

    def beyond_of(self, x: Array) -> Array:
        return np.asarray(np.rad2deg(super().beyond_of(x)))


class _Backward(PhysLimit):
    """backward split into methods; each subclass breaks one."""

    def slope(self) -> Array:
        return np.asarray(np.sign(self.beyond) if self.param.norm == "L1" else 2 * self.beyond)

    def begin(self, dL: Array) -> Array:
        return dL / len(self.beyond)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = (self.begin(top[0].diff) * self.slope()).reshape(bottom[0].shape)


class BothUp(_Backward):
    """The gradient below a lower limit is negative: v grows as x decreases."""

    def slope(self) -> Array:
        return np.abs(super().slope())


class TwoForgotten(_Backward):
    """The derivative of v² is 2 v, not v."""

    def slope(self) -> Array:
        return np.asarray(np.sign(self.beyond) if self.param.norm == "L1" else self.beyond)


class GradientOfSquare(_Backward):
    """With norm L1 the derivative of v is ±1, not 2 v."""

    def slope(self) -> Array:
        return np.asarray(2 * self.beyond)


class SlopeAtLimit(_Backward):
    """Exactly at a limit the slope is 0, and ±1 only beyond it: the limit itself is permitted. Use > instead of >= and
    < instead of <=.
    """

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        x = bottom[0].data.reshape(-1, len(self.lower))
        self.at = (x == self.upper) * 1.0 - (x == self.lower)

    def slope(self) -> Array:
        return np.asarray(super().slope() + (self.at if self.param.norm == "L1" else 0))


class SlopeIsV(_Backward):
    """With norm L1 the derivative of v is ±1 for any v > 0, not v itself."""

    def slope(self) -> Array:
        return np.asarray(self.beyond if self.param.norm == "L1" else 2 * self.beyond)


class NoTopDiff(_Backward):
    """backward ignores top[0].diff (dL), the loss weight of the prototxt."""

    def begin(self, dL: Array) -> Array:
        return np.asarray(1 / len(self.beyond))


class GradientNotDivided(_Backward):
    """The gradient is not divided by N, as the loss is."""

    def begin(self, dL: Array) -> Array:
        return dL


def _arm_like() -> Array:
    """Return two hands in the initial pose except two angles beyond a limit and two exactly at one."""
    skeleton = hand.nyu_hand()
    limited = np.flatnonzero(~skeleton.fixed & (skeleton.upper < 100))
    x = np.zeros((2, 47))
    x[0, limited[0]], x[1, limited[1]] = skeleton.upper[limited[0]] + 0.25, skeleton.lower[limited[1]] - 0.5
    x[0, limited[2]], x[1, limited[3]] = skeleton.upper[limited[2]], skeleton.lower[limited[3]]
    return x


def _poses(count: int, seed: int) -> Array:
    return np.asarray(np.random.default_rng(seed).normal(0, 1, (count, 47)))


L1, L2 = ("phys_limit_param { norm: %s }" % norm for norm in ("L1", "L2"))  # noqa: UP031

EXERCISE = layer_exercise(
    "phys_limit",
    "PhysLimit",
    title="PhysLimit: a loss on angles beyond their limits",
    chapter=10,
    file="layers/hand/phys_limit.py",
    to_do={
        "forward": "Write top[0].data: L, of x as (N, D). setup has made self.lower "
        "and self.upper. self.param.norm is L1 or L2. Store what backward needs.",
        "backward": "If propagate_down[0], write every element of bottom[0].diff: dL / N times ±1 (L1) or ±2 v (L2), 0 "
        "within the limits. dL is top[0].diff.",
    },
    letters=Letters(("x",), ("L",), axes={"x": "nd", "L": ""}),
    examples=[Example(L1, (_arm_like(),), on_kinks=True, note="two angles beyond, two at a limit"),
              Example(L2, (_arm_like(),), on_kinks=True, note="two angles beyond, two at a limit"),
              Example(L1, (_poses(2, 1),)), Example(L2, (_poses(2, 2),)), Example("", (_poses(3, 3),), gradient=False)],
    from_caffe={"phys_limit": Example(L2, ())},
    mistakes=known_in(globals(), PhysLimit),
)
