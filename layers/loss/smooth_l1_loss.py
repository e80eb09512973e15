"""SmoothL1Loss: absolute differences, squared near zero (Faster R-CNN).

bottom[0]  a        (N, ...)
bottom[1]  b        same number of items and of values per item
bottom[2]  inside   as many values as a; optional (Fast R-CNN has only these weights)
bottom[3]  outside  as many values as a; optional
top[0]     L        scalar

d  = inside (a - b)
L  = 1 / N sum of outside f(d)        f(d) = σ² d² / 2 where |d| < 1 / σ², else |d| - 1 / (2 σ²)
da =  dL / N inside outside f'(d)     f'(d) = σ² d clipped to [-1, 1]
db = -da                              no gradient for the weights

The gradient of EuclideanLoss is proportional to the error, so a joint that cannot be determined,
such as a hidden one, converges to the mean of its possible positions. Here the gradient has
constant size, so it converges to their median. With joints in half-cubes, σ = 10 is quadratic in
the last 1.5 mm.

Kept for backward: ``slope`` = f'(d).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.loss.labels import items_and_values
from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class SmoothL1LossParameter:
    """The ``smooth_l1_loss_param { ... }`` block."""

    sigma: float = numbered(1, 1.0)  # σ: quadratic up to 1 / σ²


class SmoothL1Loss(Layer):
    """Sum of absolute values over N, smooth at zero."""

    param: SmoothL1LossParameter
    param_name = "smooth_l1_loss_param"
    bottoms = (2, 4)
    tops = (1, 1)
    in_place = False
    default_loss_weight = 1.0

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.slope = np.empty(0, self.dtype)
        self.sigma2 = self.dtype.type(self.param.sigma) ** 2
        if not (self.param.sigma > 0 and 0 < self.sigma2 < np.inf):
            raise self.fail(
                f"sigma {self.param.sigma:g} must be above 0, with a finite square", "sigma"
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        shape = items_and_values(self, bottom)
        if self.slope.shape != shape:  # otherwise backward may still need it
            self.slope = np.empty(shape, self.dtype)
        top[0].reshape(())

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        a, b, *weights = (x.data.reshape(self.slope.shape) for x in bottom)
        d = a - b
        for inside in weights[:1]:
            d *= inside
        np.clip(self.sigma2 * d, -1, 1, out=self.slope)
        f = self.slope * (d - self.slope / (2 * self.sigma2))  # covers both cases of f
        for outside in weights[1:]:
            f *= outside
        top[0].data[...] = f.sum() / len(f)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if any(propagate_down[2:]):
            raise self.fail("has no gradient for its weights; set propagate_down: false for them")
        gradient = self.slope * (top[0].diff / self.dtype.type(len(self.slope)))
        for weight in bottom[2:]:
            gradient *= weight.data.reshape(gradient.shape)
        for x, down, sign in zip(bottom[:2], propagate_down, (1, -1)):
            if down:
                np.multiply(gradient, sign, out=x.diff.reshape(gradient.shape))

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index < 2
