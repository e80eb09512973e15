"""Python layers of random nets: they do what a user's layers may do with the blobs they get."""

from __future__ import annotations

import numpy as np

import netlib
from netlib.blob import Blobs
from netlib.fillers import Filler


class Gain(netlib.Layer):
    """y = gain x, with a parameter."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.gain = self.new_param("gain", (1,), Filler(type="constant", value=1.5))

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(*bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = self.gain.data * bottom[0].data

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        self.gain.diff[...] += np.sum(top[0].diff * bottom[0].data)
        if propagate_down[0]:
            bottom[0].diff[...] = self.gain.data * top[0].diff


class Writer(Gain):
    """Writes also what it reads."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        bottom[0].data[...] *= 0.5
        super().forward(bottom, top)


class Holder(Gain):
    """Keeps an array of what it reads, and reads it in later passes."""

    held: np.ndarray | None = None

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        if self.held is not None and self.held.shape == top[0].shape:
            top[0].data[...] += self.held
        self.held = bottom[0].data
