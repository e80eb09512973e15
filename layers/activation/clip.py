"""Clip: limit values to the range from ``min`` to ``max``.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = max(min, min(x, max))
dx = dy where min <= x <= max, 0 elsewhere
"""

from __future__ import annotations

from dataclasses import dataclass

from layers.activation.elementwise import Elementwise
from netlib.blob import Array
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ClipParameter:
    """The ``clip_param { ... }`` block."""

    min: float = numbered(1)
    max: float = numbered(2)


class Clip(Elementwise):
    """Limits values to a range."""

    param: ClipParameter

    def _write(self, x: Array, y: Array) -> None:
        x.clip(self.param.min, max(self.param.min, self.param.max), out=y)

    def _slope(self, x: Array) -> Array:
        return (x >= self.param.min) & (x <= self.param.max)
