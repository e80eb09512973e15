"""Exercise: the layer EuclideanLoss, where backpropagation starts."""

from __future__ import annotations

import numpy as np

from exercises.exercise import known_in
from exercises.layer_examples import Example, Letters, numbers
from exercises.layers import layer_exercise
from layers.loss.euclidean_loss import EuclideanLoss
from netlib.blob import Blobs


class NoHalf(EuclideanLoss):
    """The half is missing: L = 1 / (2 N) sum of (a - b)². It is there so that the gradient has no 2."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        a, b = (x.data.reshape(self.items, self.values) for x in bottom)
        self.difference = a - b
        top[0].data[...] = (self.difference**2).sum() / self.items


class NoItems(EuclideanLoss):
    """The sum is not divided by the number of items N, self.items."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        a, b = (x.data.reshape(self.items, self.values) for x in bottom)
        self.difference = a - b
        top[0].data[...] = (self.difference**2).sum() / 2


class MeanOfValues(EuclideanLoss):
    """The sum is divided by the number of values. Average over the items only: divide by 2 N, with N = self.items."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        a, b = (x.data.reshape(self.items, self.values) for x in bottom)
        self.difference = a - b
        top[0].data[...] = (self.difference**2).sum() / (2 * self.items * self.values)


class PlainMean(EuclideanLoss):
    """This is the mean of all squares, as in other frameworks. Caffe's loss is half the sum, divided by the number of
    items: 1 / (2 N).
    """

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        top[0].data[...] *= 2 / self.values


class Root(EuclideanLoss):
    """This is a square root. The loss is the sum of the squares; np.linalg.norm takes the root."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        top[0].data[...] = np.sqrt(2 * self.items * top[0].data) / (2 * self.items)


class Absolute(EuclideanLoss):
    """The differences are squared; do not take absolute values."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        top[0].data[...] = np.abs(self.difference).sum() / (2 * self.items)


class NoTopDiff(EuclideanLoss):
    """backward ignores top[0].diff (dL). It is the loss weight of the prototxt, and by the chain rule every gradient
    contains this factor.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        for x, down, sign in zip(bottom, propagate_down, (1, -1)):
            if down:
                x.diff[...] = (sign / self.items * self.difference).reshape(x.shape)


class _Scaled(EuclideanLoss):
    factors = (1.0, 1.0)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        for x, down, factor in zip(bottom, propagate_down, self.factors):
            if down:
                x.diff[...] *= factor


class SameSign(_Scaled):
    """db has the sign of da. b is subtracted in a - b, so db = -da."""

    factors = (1, -1)


class BothSigns(_Scaled):
    """The signs are exchanged: where a is too large, L grows with a, so da = +dL (a - b) / N."""

    factors = (-1, -1)


class GradientDoubled(_Scaled):
    """The gradient contains a factor 2. The 1/2 of the loss cancels it: da = dL (a - b) / N."""

    factors = (2, 2)


class GradientNotDivided(EuclideanLoss):
    """The gradient is not divided by N, as the loss is."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        for x, down in zip(bottom, propagate_down):
            if down:
                x.diff[...] *= self.items


EXERCISE = layer_exercise(
    "euclidean_loss",
    "EuclideanLoss",
    title="EuclideanLoss: half the mean squared distance",
    chapter=6,
    file="layers/loss/euclidean_loss.py",
    to_do={
        "forward": "Write top[0].data, one number: L = 1 / (2 N) sum of (a - b)². N is self.items; a and b "
        "have the same number of values for each item (self.values), but perhaps not the same "
        "shape. Store what backward needs.",
        "backward": "For each bottom with propagate_down: da = dL (a - b) / N, db = -dL (a - b) / N, "
        "in the shape of that bottom. dL is top[0].diff.",
    },
    letters=Letters(("a", "b"), ("L",), axes={"a": "ni", "b": "ni", "L": ""}),
    examples=[
        Example("", (numbers(4, 3), numbers(4, 3, seed=1))),
        Example("", (numbers(3, 2, 2), numbers(3, 4, seed=2))),
        Example("", (numbers(2, 5), numbers(2, 5, seed=3)), wanted=(True, False), note="gradient of the first only"),
    ],
    from_caffe={"euclid": Example("", ()), "euclid_lw3": Example("loss_weight: 3", ())},
    mistakes=known_in(globals(), EuclideanLoss),
)
