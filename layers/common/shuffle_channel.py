"""ShuffleChannel: exchange channels between the groups of a grouped convolution (ShuffleNet).

bottom[0]  x  (N, C, ...)
top[0]     y  (N, C, ...)

The channels are numbered by their group i of G and their place j of C / G in it. The two
are exchanged:

y[n, j G + i]      = x[n, i C / G + j]
                     a transpose of (N, G, C / G, ...) to (N, C / G, G, ...)
dx[n, i C / G + j] = dy[n, j G + i]
"""

from __future__ import annotations

from dataclasses import dataclass

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class ShuffleChannelParameter:
    """The ``shuffle_channel_param { ... }`` block."""

    group: UInt = numbered(1, 1)  # number of groups


class ShuffleChannel(Layer):
    """Exchanges channels between groups."""

    param: ShuffleChannelParameter
    bottoms = tops = (1, 1)
    in_place = False
    batchwise = True
    reads_bottom = reads_top = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        shape, group = bottom[0].shape, self.param.group
        if len(shape) < 2:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {shape}, expected (N, C, ...)"
            )
        if group < 1 or shape[1] % group:
            raise self.fail(
                f"group is {group}; expected a divisor of the {shape[1]} channels", "group"
            )
        self.by_group = (shape[0], group, shape[1] // group, *shape[2:])
        self.by_place = (shape[0], shape[1] // group, group, *shape[2:])
        top[0].reshape(shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data.reshape(self.by_place)[...] = (
            bottom[0].data.reshape(self.by_group).swapaxes(1, 2)
        )

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff.reshape(self.by_group)[...] = (
                top[0].diff.reshape(self.by_place).swapaxes(1, 2)
            )
