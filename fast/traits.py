"""Properties of layer types that the fast engine may use.

The defaults are safe for all layers. A type that is not in the table, such as a user's own,
runs on the whole batch. So does an InnerProduct: one product for the whole batch is faster than
many small ones.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fast.fast_layer import FastLayer
from netlib.layer import Layer
from netlib.proto.options import PACKAGE, class_at, place_of


@dataclass(frozen=True)
class LayerTraits:
    """Properties of one layer.

    batchwise      item n of a top depends only on item n of the bottoms, so the layer may run on a
                   slice of the batch; it must access its parameters by self.blobs or by name,
                   because these differ in every slice
    elementwise    each top value depends only on one bottom value, and f(0) is finite, so
                   blobs may be tiled
    monotone       elementwise, non-decreasing and f(f(x)) = f(x), so it may be moved
                   behind a max pooling
    takes_maximum  max pooling in which every top value is one of the bottom values
    reads_bottom   backward reads bottom data
    reads_top      backward reads top data
    keeps          backward may need what forward kept in the layer, such as the
                   winners of a pooling
    """

    batchwise: bool = False
    elementwise: bool = False
    monotone: bool = False
    takes_maximum: bool = False
    reads_bottom: bool = True
    reads_top: bool = True
    keeps: bool = True


def _relu(layer: Any) -> LayerTraits:
    return LayerTraits(
        batchwise=True,
        elementwise=True,
        monotone=layer.param.negative_slope == 0,
        reads_top=False,
        keeps=False,
    )


def _power(layer: Any) -> LayerTraits:
    return LayerTraits(batchwise=True, reads_bottom=layer.param.power != 1, reads_top=False)


def _convolution(layer: Any) -> LayerTraits:
    return LayerTraits(batchwise=layer.axis > 0, reads_top=False, keeps=False)


def _im2col(layer: Any) -> LayerTraits:
    return LayerTraits(batchwise=layer.axis > 0, reads_bottom=False, reads_top=False)


def _interp(layer: Any) -> LayerTraits:
    alone = len(layer.spec.bottom) == 1  # a second bottom may have another number of items
    return LayerTraits(batchwise=alone, reads_bottom=False, reads_top=False)


def _pooling(layer: Any) -> LayerTraits:
    # no empty windows
    full = all(stride <= kernel for stride, kernel in zip(layer.stride, layer.kernel))
    alone = len(layer.spec.top) == 1  # a mask depends on a layer in place that would be moved
    return LayerTraits(
        batchwise=True,
        takes_maximum=layer.is_max and full and alone,
        reads_bottom=False,
        reads_top=False,
    )


def _axis(layer: Layer) -> int:
    """The first axis of a layer, 0 before its first reshape."""
    return int(getattr(layer, "axis", 0))


def _scale(layer: Any) -> LayerTraits:
    # a second bottom may have no items
    own = layer.learned and (_axis(layer) > 0 or layer.gain.shape == ())
    return LayerTraits(batchwise=own, reads_top=False)


def _bias(layer: Any) -> LayerTraits:
    own = layer.learned and (layer.bias.shape == () or 0 in getattr(layer, "others", ()))
    return LayerTraits(batchwise=own, reads_bottom=False, reads_top=False)


def _bn(layer: Any) -> LayerTraits:
    return LayerTraits(batchwise=not layer.of_batch, reads_bottom=False, reads_top=False)


def _batch_norm(layer: Any) -> LayerTraits:
    return LayerTraits(batchwise=layer.uses_sums, reads_bottom=False, reads_top=False)


def _eltwise(layer: Any) -> LayerTraits:
    product = layer.param.operation == "PROD"
    return LayerTraits(batchwise=True, reads_bottom=product, reads_top=layer.reads_top)


def _concat(layer: Any) -> LayerTraits:
    return LayerTraits(batchwise=_axis(layer) > 0, reads_bottom=False, reads_top=False)


def _softmax(layer: Any) -> LayerTraits:
    return LayerTraits(batchwise=_axis(layer) > 0, reads_bottom=False)


def _permute(layer: Any) -> LayerTraits:
    items_first = getattr(layer, "axes", (1,))[0] == 0  # unknown before the first reshape
    return LayerTraits(batchwise=items_first, reads_bottom=False, reads_top=False)


def _dropout(layer: Any) -> LayerTraits:
    return LayerTraits(batchwise=not layer.active, reads_bottom=False, reads_top=False)


# Traits of the class at a place in layers/, or a function of the layer if they depend
# on its options.
TABLE: dict[str, LayerTraits | Callable[..., LayerTraits]] = {
    "activation.absval.AbsVal": LayerTraits(batchwise=True, reads_top=False),
    "activation.bias.Bias": _bias,
    "activation.bnll.BNLL": LayerTraits(batchwise=True, reads_top=False),
    "activation.clip.Clip": LayerTraits(batchwise=True, reads_top=False),
    "activation.elu.ELU": LayerTraits(batchwise=True, reads_top=False),
    "activation.exp.Exp": LayerTraits(batchwise=True, reads_bottom=False),
    "activation.log.Log": LayerTraits(batchwise=True, reads_top=False),
    "activation.power.Power": _power,
    "activation.prelu.PReLU": LayerTraits(batchwise=True, reads_top=False),
    "activation.relu.ReLU": _relu,
    "activation.relu6.ReLU6": _relu,
    "activation.scale.Scale": _scale,
    "activation.sigmoid.Sigmoid": LayerTraits(batchwise=True, elementwise=True, reads_bottom=False),
    "activation.swish.Swish": LayerTraits(batchwise=True, reads_top=False),
    "activation.tanh.TanH": LayerTraits(batchwise=True, elementwise=True, reads_bottom=False),
    "common.concat.Concat": _concat,
    "common.dropout.Dropout": _dropout,
    "common.eltwise.Eltwise": _eltwise,
    "common.permute.Permute": _permute,
    "common.shuffle_channel.ShuffleChannel": LayerTraits(
        batchwise=True, reads_bottom=False, reads_top=False
    ),
    "common.softmax.Softmax": _softmax,
    "common.split.Split": LayerTraits(
        batchwise=True, elementwise=True, reads_bottom=False, reads_top=False, keeps=False
    ),
    "normalization.batch_norm.BatchNorm": _batch_norm,
    "normalization.bn.BN": _bn,
    "normalization.lrn.LRN": LayerTraits(batchwise=True, reads_top=False),
    "vision.convolution.Convolution": _convolution,
    "vision.deconvolution.Deconvolution": _convolution,
    "vision.im2col.Im2col": _im2col,
    "vision.interp.Interp": _interp,
    "vision.nearest_upsample.NearestUpsample": LayerTraits(
        batchwise=True, reads_bottom=False, reads_top=False
    ),
    "vision.pooling.Pooling": _pooling,
    "vision.upsample.Upsample": LayerTraits(batchwise=True, reads_top=False),
}


def traits_of(layer: Layer) -> LayerTraits:
    """The traits of a layer's type, or of the plain type that it implements."""
    cls: type = type(layer)
    found = _traits_of_type(cls)
    return found if isinstance(found, LayerTraits) else found(layer)


@functools.cache
def _traits_of_type(cls: type) -> LayerTraits | Callable[..., LayerTraits]:
    """The entry of the table for a layer's class."""
    lineage = cls.__mro__ if issubclass(cls, FastLayer) else [cls]  # a user's subclass may differ
    places = (
        place
        for one in lineage
        if (place := place_of(one)) in TABLE and class_at(PACKAGE, place) is one
    )
    return TABLE.get(next(places, ""), LayerTraits())
