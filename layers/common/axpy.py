"""Axpy: a x + y with one factor per channel; the last step of a "squeeze and excitation"
block (SENet).

bottom[0]  a  (N, C) or (N, C, 1, 1)
bottom[1]  x  (N, C, H, W)
bottom[2]  y  (N, C, H, W)
top[0]     z  (N, C, H, W)

z  = a x + y
da = sum of x dz over h, w        dx = a dz        dy = dz
"""

from __future__ import annotations

from netlib.blob import Blobs
from netlib.layer import Layer


class Axpy(Layer):
    """Scales the channels of one blob and adds another."""

    bottoms = (3, 3)
    tops = (1, 1)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        a, x, y = (blob.shape for blob in bottom)
        names = self.spec.bottom
        has_channels = len(x) >= 2 and a[:2] == x[:2]
        if not has_channels or bottom[0].count != x[0] * x[1]:
            raise self.fail(
                f"bottom {names[0]!r} {a} must have one number per item and channel of "
                f"{names[1]!r} {x}"
            )
        if x != y:
            raise self.fail(
                f"bottoms {names[1]!r} {x} and {names[2]!r} {y} must have the same shape"
            )
        self.wide = (*x[:2], *(1,) * (len(x) - 2))  # shape of a for broadcasting
        top[0].reshape(x)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        a, x, y = (blob.data for blob in bottom)
        top[0].data[...] = a.reshape(self.wide) * x + y

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        (a, x, _), dz = (blob.data for blob in bottom), top[0].diff
        if propagate_down[0]:
            over = tuple(range(2, dz.ndim))
            bottom[0].diff[...] = (x * dz).sum(axis=over).reshape(a.shape)
        if propagate_down[1]:
            bottom[1].diff[...] = a.reshape(self.wide) * dz
        if propagate_down[2]:
            bottom[2].diff[...] = dz
