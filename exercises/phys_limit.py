"""Exercise: the layer PhysLimit, a loss on angles beyond their limits."""

from __future__ import annotations

import numpy as np

from exercises import hand
from exercises.exercise import Mistake
from exercises.layers import Example, Letters, Option, layer_exercise, numbers
from netlib.blob import Array

DX = "top[0].diff / len(slope) * slope"

LOWER_LIMIT_IGNORED = Mistake(
    "An angle below its lower limit is also out of limits: v = max(lower - x, 0) + max(x - upper, 0).",
    (
        "self.beyond = np.maximum(x - self.upper, 0) - np.maximum(self.lower - x, 0)",
        "self.beyond = np.maximum(x - self.upper, 0)",
    ),
)
VIOLATIONS_CANCEL = Mistake(
    "Violations of lower limits are subtracted from those of upper limits. v counts both as positive.",
    ("v = np.abs(self.beyond)", "v = self.beyond"),
)
NOT_DIVIDED_BY_N = Mistake(
    "The sum is not divided by the number of poses N.",
    ("top[0].data[...] = total / len(x)", "top[0].data[...] = total"),
)
SIGN_IGNORED = Mistake(
    "The gradient below a lower limit is negative: v grows as x decreases.",
    (DX, "top[0].diff / len(slope) * np.abs(slope)"),
)
DL_IGNORED = Mistake(
    "backward ignores top[0].diff (dL), the loss weight of the prototxt.",
    (DX, "slope / len(slope)"),
)
MISTAKES = (LOWER_LIMIT_IGNORED, VIOLATIONS_CANCEL, NOT_DIVIDED_BY_N, SIGN_IGNORED, DL_IGNORED)


def _at_limits() -> Array:
    """Return two poses (2, 47), zero except two angles beyond a limit and two exactly at one."""
    above, below = [15, 16], [17, 18]  # DoFs of the thumb, which have limits
    x = np.zeros((2, 47))
    x[0, above] = hand.NYU.upper[above] + (0.25, 0)
    x[1, below] = hand.NYU.lower[below] - (0.5, 0)
    return x


TO_DO = {
    "forward": "Write top[0].data: L, of x as (N, D). setup has made self.lower "
    "and self.upper. self.param.norm is L1 or L2. Store what backward needs.",
    "backward": "If propagate_down[0], write every element of bottom[0].diff: dL / N times ±1 (L1) or ±2 v (L2), 0 "
    "within the limits. dL is top[0].diff.",
}
LETTERS = Letters({"x": "n d"}, {"L": ""})
EXAMPLES = (
    Example(bottoms=(_at_limits(),), on_kinks=True),
    Example(bottoms=(2 * numbers(2, 47, 1),)),
)
SQUARED = Option(
    "norm: L2",
    "Each v is squared before the sum, so dx is dL / N times 2 v, with the sign of the violation.",
    Example("norm: L2", (_at_limits(),), on_kinks=True),
    Example("norm: L2", (2 * numbers(2, 47, 1, seed=2),)),
    Example("norm: L2", caffe="phys_limit"),
)

EXERCISE = layer_exercise(
    "PhysLimit",
    title="PhysLimit: a loss on angles beyond their limits",
    chapter=10,
    block="phys_limit_param",
    to_do=TO_DO,
    letters=LETTERS,
    examples=EXAMPLES,
    options=(SQUARED,),
    mistakes=MISTAKES,
)
