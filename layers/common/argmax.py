"""ArgMax: indices of the largest values.

bottom[0]  x  (N, ...)
top[0]     y  without ``axis``: (N, 1, k), padded with axes of size 1 to the number of axes of x:
              per item the indices of its k = ``top_k`` largest values among all of its values, from
              0, largest first; with ``out_max_val``: (N, 2, k): the indices, then the values with
              ``axis``: the shape of x, but k along ``axis``: the indices along it, or with
              ``out_max_val`` the values instead

Ties are in the order of decreasing index, as in Caffe. There is no gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class ArgMaxParameter:
    """The ``argmax_param { ... }`` block."""

    # return the values too, or with ``axis`` instead of the indices
    out_max_val: bool = numbered(1, False)
    top_k: UInt = numbered(2, 1)  # number of indices
    axis: int | None = numbered(3, None)  # axis to search along; by default the whole item


class ArgMax(Layer):
    """Indices of the largest values."""

    param: ArgMaxParameter
    param_name = "argmax_param"
    bottoms = tops = (1, 1)
    in_place = False
    has_gradient = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        p, x = self.param, bottom[0]
        if p.axis is not None:
            self.axis = self.canonical_axis(p.axis, x)
            values = x.shape[self.axis]
            what = f"the {values} values along axis {self.axis}"
            shape = list(x.shape)
            shape[self.axis] = p.top_k
        else:
            items = x.shape[self.canonical_axis(0, x, "first axis")]
            values = math.prod(x.shape[1:])
            what = f"the {values} values of an item"
            shape = [items, 2 if p.out_max_val else 1, p.top_k] + [1] * (len(x.shape) - 3)
        if not 1 <= p.top_k <= values:
            raise self.fail(
                f"top_k {p.top_k} must be from 1 to {what} of {self.spec.bottom[0]!r} {x.shape}",
                "top_k",
            )
        top[0].reshape(shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        p, x, y = self.param, bottom[0].data, top[0].data
        x = x.reshape(len(x), -1) if p.axis is None else np.moveaxis(x, self.axis, -1)
        ascending = np.argsort(x, axis=-1, kind="stable")
        places = ascending[..., : -p.top_k - 1 : -1]  # reversed, so ties are too
        values = np.take_along_axis(x, places, axis=-1)
        if p.axis is not None:
            y[...] = np.moveaxis(values if p.out_max_val else places, -1, self.axis)
        else:
            y[:, 0] = places.reshape(y[:, 0].shape)
            if p.out_max_val:
                y[:, 1] = values.reshape(y[:, 1].shape)
