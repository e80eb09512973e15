"""PhysLimit: a loss on joint angles outside the range of a hand (Sec. 3.2 of the paper).

bottom[0]  x  (N, D)   values of the skeleton's DoFs, as for HandModel
top[0]     L  scalar

v  = max(lower - x, 0) + max(x - upper, 0)    excess over the limit; 0 for fixed and unlimited DoFs
L  = 1 / N sum of v        norm L1, Eq. 2 of the paper
     1 / N sum of v²       norm L2, the released system (type "DeepHandModelDofConstraintLoss")
dx = dL / N · (±1 or ±2v), + above the upper limit, - below the lower one; 0 at the limit

Kept for backward: ``beyond`` = max(x - upper, 0) - max(lower - x, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from layers.hand.skeleton import load_for
from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class PhysLimitParameter:
    """The ``phys_limit_param { ... }`` block."""

    norm: Literal["L1", "L2"] = numbered(1, "L1")  # linear hinge, or squared
    skeleton: str = numbered(2, "")  # path of a skeleton file; default is the packaged NYU hand


@dataclass(frozen=True)
class ReleasedPhysLimitParameter(PhysLimitParameter):
    """Options of the released system's layer: the hinge is squared."""

    norm: Literal["L1", "L2"] = numbered(1, "L2")


class PhysLimit(Layer):
    """Hinge loss on the limits of the DoFs."""

    param: PhysLimitParameter
    param_name = "phys_limit_param"
    bottoms = tops = (1, 1)
    in_place = False
    default_loss_weight = 1.0

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        skeleton = load_for(self.param.skeleton, self.source)
        self.lower = np.where(skeleton.fixed, -np.inf, skeleton.lower).astype(self.dtype)
        self.upper = np.where(skeleton.fixed, np.inf, skeleton.upper).astype(self.dtype)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        D = len(self.lower)
        if not bottom[0].shape or bottom[0].count != bottom[0].num * D:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {bottom[0].shape}, the skeleton has {D} DoFs"
            )
        top[0].reshape(())

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data.reshape(-1, len(self.lower))
        self.beyond = np.maximum(x - self.upper, 0) - np.maximum(self.lower - x, 0)
        v = np.abs(self.beyond)
        total = v.sum() if self.param.norm == "L1" else np.vdot(v, v)
        top[0].data[...] = total / len(x)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            slope = np.sign(self.beyond) if self.param.norm == "L1" else 2 * self.beyond
            bottom[0].diff[...] = (top[0].diff / len(slope) * slope).reshape(bottom[0].shape)


class ReleasedPhysLimit(PhysLimit):
    """PhysLimit under the released system's name."""

    param: ReleasedPhysLimitParameter
