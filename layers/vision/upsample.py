"""Upsample with a mask: put each value where a max pooling found it (SegNet).

bottom[0]  x     (N, C, H, W)
bottom[1]  mask  (N, C, H, W)    second top of a Pooling: index h Wo + w of each maximum in its map
top[0]     y     (N, C, Ho, Wo)

y[n, c, mask[n, c, i]] = x[n, c, i]        0 elsewhere; of values with the same index, the last one
                                           in row order counts
dx[n, c, i] = dy[n, c, mask[n, c, i]]      0 for values that another one has replaced

The size of y is ``upsample_h`` x ``upsample_w`` if given, or H ``scale`` x W ``scale``
(``scale_h``, ``scale_w``). With scale 2, ``pad_out_h`` and ``pad_out_w`` subtract 1. The gradient
of mask is 0. With one bottom, the type Upsample is another layer (nearest_upsample.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.common.images import check_images
from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class UpsampleParameter:
    """The ``upsample_param { ... }`` block."""

    scale: UInt | None = numbered(1, None)  # by default 2 with a mask, and 1 without
    scale_h: UInt | None = numbered(2, None)  # the others are for a mask only
    scale_w: UInt | None = numbered(3, None)
    pad_out_h: bool = numbered(4, False)  # one row less than scale_h = 2 gives
    pad_out_w: bool = numbered(5, False)
    upsample_h: UInt | None = numbered(6, None)  # size of the top
    upsample_w: UInt | None = numbered(7, None)


class Upsample(Layer):
    """Puts values at the places of a max pooling's mask."""

    param: UpsampleParameter
    bottoms = (2, 2)
    tops = (1, 1)
    in_place = False
    batchwise = True
    reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        own, self.size = self._pair("scale_h", "scale_w"), self._pair("upsample_h", "upsample_w")
        if p.scale is not None and own is not None:
            raise self.fail("give either scale, or scale_h and scale_w", "scale")
        both = 2 if p.scale is None else p.scale
        self.scale = own or (both, both)
        if min(self.size or self.scale) < 2:
            raise self.fail(
                f"{'upsample_h and upsample_w' if self.size else 'scale'} must be at least 2"
            )
        for name, scale in zip(("pad_out_h", "pad_out_w"), self.scale):
            if self.size is None and getattr(p, name) and scale != 2:
                raise self.fail(
                    f"{name} is for scale 2, not {scale}; expected upsample_h and upsample_w", name
                )

    def _pair(self, *names: str) -> tuple[int, int] | None:
        """Two options that are given together; None if neither is given."""
        one, other = (getattr(self.param, name) for name in names)
        if one is None and other is None:
            return None
        if one is None or other is None:
            raise self.fail(f"needs {names[0]} and {names[1]}", names[one is None])
        return one, other

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, mask, p = bottom[0].shape, bottom[1].shape, self.param
        check_images(self, bottom[:1])
        if mask != x:
            names = self.spec.bottom
            raise self.fail(
                f"bottoms {names[0]!r} {x} and {names[1]!r} {mask}, the mask of a "
                "Pooling, must have the same shape"
            )
        less = (p.pad_out_h, p.pad_out_w)
        scaled = [n * s - one for n, s, one in zip(x[2:], self.scale, less)]
        top[0].reshape(*x[:2], *(self.size or scaled))

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        y = top[0].data
        y[...] = 0
        # the last of several values counts
        self._maps(y)[self._places(bottom, top)] = self._maps(bottom[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            places = self._places(bottom, top)
            dx, dy = self._maps(bottom[0].diff), self._maps(top[0].diff)
            number = np.broadcast_to(np.arange(dx.shape[1]), dx.shape)
            last = np.full(dy.shape, -1)
            last[places] = number
            dx[...] = dy[places] * (last[places] == number)
        if propagate_down[1]:
            bottom[1].diff[...] = 0

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index == 0

    def _places(self, bottom: Blobs, top: Blobs) -> tuple[Array, Array]:
        """Map (N C, 1) and index (N C, H W) of each value in the top.

        Raises LayerError if an index is invalid.
        """
        mask, (Ho, Wo) = bottom[1].data, top[0].shape[2:]
        for place in np.argwhere(~((mask >= 0) & (mask < Ho * Wo)))[:1]:
            name, at = self.spec.bottom[1], tuple(map(int, place))
            raise self.fail(
                f"mask {name!r} is {mask[at]:g} at {at}, expected 0 to "
                f"{Ho * Wo - 1} for a top of {Ho} x {Wo}; its Pooling must read a map of this size"
            )
        index = self._maps(mask).astype(int)
        return np.arange(len(index))[:, None], index

    @staticmethod
    def _maps(array: Array) -> Array:
        """View of (N, C, H, W) as one row for each map."""
        N, C, H, W = array.shape
        return array.reshape(N * C, H * W)
