"""Exercise: the layer ReLU, the simplest one."""

from __future__ import annotations

import numpy as np

from exercises.exercise import known_in
from exercises.layer_examples import Example, Letters, numbers
from exercises.layers import layer_exercise
from layers.activation.relu import ReLU
from netlib.blob import Blobs


class ForgetsSlope(ReLU):
    """negative_slope is ignored: a negative x becomes slope * x, with self.slope, not 0."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = np.maximum(bottom[0].data, 0)


class SwapsSides(ReLU):
    """The two sides are exchanged: y is x where x > 0, and slope * x elsewhere."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        top[0].data[...] = x * ((x <= 0) + self.slope * (x > 0))


class ReadsWhatItWrote(ReLU):
    """In place, top[0].data and bottom[0].data are the same array, so reading x after writing y reads y. Compute the
    result in one expression.
    """

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y = bottom[0].data, top[0].data
        y[...] = np.maximum(x, 0)
        y += self.slope * np.minimum(x, 0)


class ChangesBottom(ReLU):
    """forward changes bottom[0].data. It belongs to the previous layer, which may need it in its backward; write only
    into top[0].data.
    """

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        x[x < 0] *= self.slope
        top[0].data[...] = x


class ForgetsSlopeBackward(ReLU):
    """backward ignores the slope: where x <= 0 the gradient is slope * dy, not 0."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        bottom[0].diff[...] = top[0].diff * (bottom[0].data > 0)


class ForgetsTopDiff(ReLU):
    """backward ignores top[0].diff. By the chain rule, dx is dy where x > 0 and slope * dy elsewhere."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        x = bottom[0].data
        bottom[0].diff[...] = (x > 0) + self.slope * (x <= 0)


class OneAtZero(ReLU):
    """At x = 0 Caffe uses the slope of the negative side: dx is dy only where x > 0, so use > instead of >=."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        x = bottom[0].data
        bottom[0].diff[...] = top[0].diff * ((x >= 0) + self.slope * (x < 0))


class LooksAtGradient(ReLU):
    """backward uses the sign of dy. It must use the sign of x: dx is dy where x > 0."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy = top[0].diff
        bottom[0].diff[...] = dy * ((dy > 0) + self.slope * (dy <= 0))


class TimesOutput(ReLU):
    """The slope is multiplied by y. By the chain rule it is multiplied by dy, the gradient of the loss."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        x = bottom[0].data
        bottom[0].diff[...] = np.where(x > 0, 1, self.slope) * np.where(x > 0, x, self.slope * x)


LEAKY = "relu_param { negative_slope: 0.1 }"

EXERCISE = layer_exercise(
    "relu",
    "ReLU",
    title="ReLU: set negative values to zero",
    chapter=1,
    file="layers/activation/relu.py",
    to_do={
        "reshape": "Give top[0] the shape of bottom[0].",
        "forward": "Read bottom[0].data (x) and write top[0].data (y): x where x > 0, self.slope * x elsewhere. Write "
        "into the existing array, top[0].data[...] = ..., and do not change bottom[0].data.",
        "backward": "If propagate_down[0], write every element of bottom[0].diff (dx): top[0].diff (dy) where x > 0, "
        "self.slope * dy elsewhere.",
    },
    letters=Letters(("x",), ("y",), axes={"x": "ncw", "y": "ncw"}),
    examples=[
        Example("", (numbers(2, 3, 4),)),
        Example(LEAKY, (numbers(2, 3, 4, seed=1),)),
        Example(LEAKY, (numbers(2, 3, 4, seed=2),), in_place=True),
    ],
    from_caffe={"relu": Example("", ()), "relu_neg": Example(LEAKY, ())},
    mistakes=known_in(globals(), ReLU),
)
