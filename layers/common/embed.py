"""Embed: look up learned vectors by index.

Equivalent to InnerProduct of one-hot vectors, but faster.

bottom[0]  i  any shape: integers from 0 to K - 1, with K = ``input_dim``
params[0]  w  (K, O)
params[1]  b  (O,)        unless ``bias_term: false``
top[0]     y  (..., O): the shape of i with one more axis

y[..., :] = w[i[...]] + b
dw[k]     = sum of dy[..., :] where i[...] = k,    db = sum of dy;     i has no gradient
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class EmbedParameter:
    """The ``embed_param { ... }`` block."""

    num_output: UInt = numbered(1)  # O, size of a vector
    input_dim: UInt = numbered(2)  # K, number of vectors: the largest index plus 1
    bias_term: bool = numbered(3, True)
    weight_filler: Filler = numbered(4, Filler())
    bias_filler: Filler = numbered(5, Filler())


class Embed(Layer):
    """Table of learned vectors."""

    param: EmbedParameter
    bottoms = tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        for name in ("num_output", "input_dim"):
            if getattr(p, name) == 0:
                raise self.fail(f"{name} must be at least 1", name)
        self.weight = self.new_param("weight", (p.input_dim, p.num_output), p.weight_filler)
        if p.bias_term:
            self.bias = self.new_param("bias", (p.num_output,), p.bias_filler)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(*bottom[0].shape, self.param.num_output)

    def allow_force_backward(self, bottom_index: int) -> bool:
        return False

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        index, K = bottom[0].data, self.param.input_dim
        wrong = index[~((index >= 0) & (index < K) & (index == np.floor(index)))]
        if wrong.size:
            name = self.spec.bottom[0]
            raise self.fail(
                f"bottom {name!r} holds {wrong[0]:g}, expected whole numbers "
                f"from 0 to {K - 1} (input_dim {K})",
                "input_dim",
            )
        top[0].data[...] = self.weight.data[index.astype(np.intp)]
        if self.param.bias_term:
            top[0].data[...] += self.bias.data

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            raise self.fail(
                f"the indices {self.spec.bottom[0]!r} have no gradient; set propagate_down: false"
            )
        dy = top[0].diff
        np.add.at(self.weight.diff, bottom[0].data.astype(np.intp), dy)
        if self.param.bias_term:
            self.bias.diff[...] += dy.sum(axis=tuple(range(dy.ndim - 1)))
