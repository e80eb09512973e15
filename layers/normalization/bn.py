"""BN: batch normalization with a learned scale and bias, as in forks of Caffe before the layers
BatchNorm and Scale.

bottom[0]  x         (N, C, H, W)
params[0]  scale     (1, C, 1, 1)   SegNet: scale_filler; PSPNet: slope_filler
params[1]  bias      (1, C, 1, 1)   SegNet: shift_filler; PSPNet: bias_filler
params[2]  mean      (1, C, 1, 1)   PSPNet only: moving averages of the batches' means and
                                    variances; not learned
params[3]  variance  (1, C, 1, 1)
top[0]     y         (N, C, H, W)   may be the same blob
top[1]     m         (1, C, 1, 1)   optional, SegNet only: mean and variance of the batch,
                                    without gradient
top[2]     v         (1, C, 1, 1)

z = (x - m) / s        y = scale z + bias        s = sqrt(v + eps), for each channel

    SegNet  ``bn_mode: LEARN``: m and v are those of the batch, in both phases; eps = 1e-9
            ``bn_mode: INFERENCE``: m = 0 and s = 1; its scripts have multiplied the statistics into
            scale and bias
    PSPNet  TEST, or ``frozen``: m = mean and v = variance TRAIN: m and v are those of the batch,
            and mean <- momentum mean + (1 - momentum) m, same for the variance

dscale = sum of z dy        dbias = sum of dy        with g = scale dy,
dx = g / s, or with the statistics of the batch (g - mean of g - z * mean of (z g)) / s

The options tell which fork is meant. Kept for backward: ``z``, because the next layer may run in
place, and ``s``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from layers.common.images import check_images
from netlib.blob import Blobs
from netlib.fillers import Filler
from netlib.layer import TEST, Layer
from netlib.proto import schema
from netlib.proto.messages import ParamSpec
from netlib.proto.schema import Engine, numbered

SEGNET = ("bn_mode", "scale_filler", "shift_filler")
PSPNET = ("slope_filler", "bias_filler", "momentum", "eps", "frozen")


@dataclass(frozen=True)
class BNParameter:
    """The ``bn_param { ... }`` block, with the numbers of PSPNet's fork."""

    slope_filler: Filler = numbered(1, Filler())
    bias_filler: Filler = numbered(2, Filler())
    momentum: float = numbered(3, 0.9)  # of the moving averages
    eps: float = numbered(4, 1e-5)
    # use the moving averages in both phases, and do not learn scale and bias
    frozen: bool = numbered(5, False)
    engine: Engine = numbered(6, "DEFAULT")  # accepted, ignored
    scale_filler: Filler = numbered(1001, Filler())  # of SegNet's fork, whose numbers are 1 to 3
    shift_filler: Filler = numbered(1002, Filler())
    bn_mode: Literal["LEARN", "INFERENCE"] = numbered(1003, "LEARN")


class BN(Layer):
    """Batch normalization with scale and bias."""

    param: BNParameter
    param_name = "bn_param"
    bottoms = (1, 1)
    tops = (1, 3)
    reads_bottom = reads_top = False
    moving = True

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        segnet, pspnet = (
            [name for name in names if schema.is_given(p, name)] for names in (SEGNET, PSPNET)
        )
        if bool(segnet) == bool(pspnet):
            one, other = ", ".join(SEGNET), ", ".join(PSPNET)
            found = f"found {segnet[0]} and {pspnet[0]}" if segnet else "found neither"
            raise self.fail(
                f"expected options of SegNet's BN ({one}) or of PSPNet's ({other}), {found}",
                segnet[0] if segnet else None,
            )
        if pspnet and len(top) > 1:
            raise self.fail(
                f"has {len(top)} tops, but only SegNet's BN has tops for mean and variance"
            )
        check_images(self, bottom)
        self.averages = bool(pspnet)
        self.of_batch = not (p.frozen or self.phase == TEST) if pspnet else p.bn_mode == "LEARN"
        self.batchwise = not self.of_batch
        self.eps = p.eps if pspnet else 1e-9
        shape = (1, bottom[0].shape[1], 1, 1)
        self.scale = self.new_param("scale", shape, p.slope_filler if pspnet else p.scale_filler)
        self.bias = self.new_param("bias", shape, p.bias_filler if pspnet else p.shift_filler)
        if pspnet:
            self.mean = self.new_param("mean", shape, Filler())
            self.variance = self.new_param(
                "variance", shape, Filler(value=1.0 if p.frozen else 0.0)
            )
            given = [*self.spec.param, *[ParamSpec()] * 4]
            fixed = ParamSpec(lr_mult=0.0, decay_mult=0.0)
            learned = [
                schema.changed(one, lr_mult=0.0, decay_mult=0.0) if p.frozen else one
                for one in given[:2]
            ]
            self.spec = schema.changed(self.spec, param=(*learned, fixed, fixed))

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        shape, (_, C, _, _) = bottom[0].shape, self.scale.shape
        if len(shape) != 4 or shape[1] != C:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {shape}, expected (N, {C}, H, W)"
            )
        if bottom[0].count == 0 and self.of_batch:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} {shape} has no values, so no mean exists"
            )
        top[0].reshape(shape)
        for statistic in top[1:]:
            statistic.reshape(1, C, 1, 1)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        m, v = np.zeros_like(self.scale.data), np.ones_like(self.scale.data)
        if self.of_batch:
            m = x.mean(axis=(0, 2, 3), keepdims=True)
            v = np.square(x - m).mean(axis=(0, 2, 3), keepdims=True)
            for statistic, values in zip(top[1:], (m, v)):
                statistic.data[...] = values
        elif self.averages:
            m, v = self.mean.data, self.variance.data
        self.s = np.sqrt(v + self.eps) if self.of_batch or self.averages else v
        self.z = (x - m) / self.s
        top[0].data[...] = self.scale.data * self.z + self.bias.data
        if self.averages and self.of_batch:
            for average, values in ((self.mean.data, m), (self.variance.data, v)):
                average *= self.param.momentum
                average += (1 - self.param.momentum) * values

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy, z = top[0].diff, self.z
        self.scale.diff[...] += (z * dy).sum(axis=(0, 2, 3), keepdims=True)
        self.bias.diff[...] += dy.sum(axis=(0, 2, 3), keepdims=True)
        if propagate_down[0]:
            g = self.scale.data * dy
            if self.of_batch:
                mean = g.mean(axis=(0, 2, 3), keepdims=True)
                along_z = (z * g).mean(axis=(0, 2, 3), keepdims=True)
                g -= mean + z * along_z
            bottom[0].diff[...] = g / self.s
