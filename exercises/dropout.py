"""Exercise: the layer Dropout, which behaves differently in training and testing."""

from __future__ import annotations

import numpy as np

from exercises.exercise import known_in
from exercises.layer_examples import Example, Letters, numbers
from exercises.layers import layer_exercise
from layers.common.dropout import Dropout
from netlib.blob import Array, Blobs
from netlib.layer import TEST, TRAIN


class _Drawn(Dropout):
    """forward split into methods; each subclass breaks one."""

    def draw(self, shape: tuple[int, ...]) -> Array:
        return self.rng.integers(0, 1 << 16, shape, dtype=np.uint16)

    def kept(self, drawn: Array) -> Array:
        return np.asarray(drawn >= min(round(self.param.dropout_ratio * (1 << 16)), (1 << 16) - 1))

    def scale(self) -> float:
        return float(self.in_training)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.factor = self.in_test
        if self.active:
            self.factor = (self.kept(self.draw(bottom[0].shape)) * self.scale()).astype(self.dtype)
        top[0].data[...] = bottom[0].data * self.factor


class NeverScales(_Drawn):
    """The values kept are not scaled. In phase TRAIN they are x / (1 - p), which preserves the mean, so TEST needs no
    scaling.
    """

    def scale(self) -> float:
        return 1.0


class ScalesByP(_Drawn):
    """The values kept are divided by p. A value is kept with probability 1 - p and divided by 1 - p."""

    def scale(self) -> float:
        return float(1 / self.param.dropout_ratio) if self.param.scale_train else 1.0


class KeepsTheDropped(_Drawn):
    """The mask is inverted: p, the dropout_ratio, is the fraction dropped, so a value is kept where drawn >= least."""

    def kept(self, drawn: Array) -> Array:
        return ~super().kept(drawn)


class DrawsOtherwise(_Drawn):
    """The random numbers are drawn differently. This is valid, but the results cannot be compared: draw them as the
    comment in the stub shows.
    """

    def kept(self, drawn: Array) -> Array:
        return np.asarray(self.rng.random(drawn.shape) >= self.param.dropout_ratio)

    def draw(self, shape: tuple[int, ...]) -> Array:
        return np.empty(shape)


class OneMaskForAll(_Drawn):
    """All items of the batch drop the same units. Draw each value independently: the mask has the full shape of x."""

    def draw(self, shape: tuple[int, ...]) -> Array:
        return np.broadcast_to(super().draw(shape[1:]), shape)


class DrawsOnce(_Drawn):
    """The mask is drawn only once. Each forward draws a new mask; only backward reuses it."""

    def draw(self, shape: tuple[int, ...]) -> Array:
        if not hasattr(self, "first"):
            self.first = super().draw(shape)
        return self.first


class DropsInTest(_Drawn):
    """In phase TEST nothing is dropped: y = x. Draw a mask only if self.active."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        super().setup(bottom, top)
        self.active = True


class ScalesInTest(Dropout):
    """In phase TEST nothing is scaled: TRAIN has already scaled by 1 / (1 - p)."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        if self.phase == TEST and self.param.scale_train:
            top[0].data[...] = bottom[0].data * (1 - self.param.dropout_ratio)


class IgnoresScaleTrain(Dropout):
    """The option scale_train is ignored. If it is false, TEST scales instead of TRAIN; self.in_training and
    self.in_test hold the factors.
    """

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        super().setup(bottom, top)
        self.in_training = self.dtype.type(1 / (1 - self.param.dropout_ratio))
        self.in_test = self.dtype.type(1)


class PassesAll(Dropout):
    """backward propagates the gradient of dropped values. They do not affect the loss: dx = dy factor."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        bottom[0].diff[...] = top[0].diff


class NoScaleBackward(Dropout):
    """backward does not scale the values kept: y = x / (1 - p), so dx = dy / (1 - p)."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        bottom[0].diff[...] = top[0].diff * (self.factor != 0)


class DrawsAgain(_Drawn):
    """backward draws a new mask. It must use that of the last forward, stored in self.factor."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if self.phase == TRAIN:
            self.factor = (self.kept(self.draw(bottom[0].shape)) * self.scale()).astype(self.dtype)
        super().backward(top, propagate_down, bottom)


def _options(p: float, more: str = "") -> str:
    return f"dropout_param {{ dropout_ratio: {p}{more} }}"


EXERCISE = layer_exercise(
    "dropout",
    "Dropout",
    title="Dropout: random values are set to zero",
    chapter=7,
    file="layers/common/dropout.py",
    to_do={
        "reshape": "Give top[0] the shape of bottom[0].",
        "forward": "Write top[0].data: y = x factor, and store self.factor for backward. If not self.active it is "
        "self.in_test, else (drawn >= least) * self.in_training, with a new draw each time:\n"
        "drawn = self.rng.integers(0, 1 << 16, bottom[0].shape, dtype=np.uint16), least = round(p 65536), p = "
        "self.param.dropout_ratio. Draw exactly like this, so that the results can be compared.",
        "backward": "If propagate_down[0], write bottom[0].diff: dx = dy factor, with the factor of the last forward.",
    },
    letters=Letters(("x",), ("y",), axes={"x": "ni", "y": "ni"}),
    examples=[
        Example(_options(0.3), (numbers(4, 5),)),
        Example(_options(0.3), (numbers(4, 5, seed=3),), forwards=2, gradient=False, note="the second forward"),
        Example(_options(0.3), (numbers(4, 5, seed=1),), phase="TEST"),
        Example(_options(0.3, " scale_train: false"), (numbers(4, 5, seed=2),)),
        Example(_options(0.3, " scale_train: false"), (numbers(4, 5, seed=4),), phase="TEST"),
        Example(_options(0.7), (numbers(4, 5, seed=5),), in_place=True),
    ],
    from_caffe={
        "dropout_test": Example(_options(0.3), (), phase="TEST"),
        "dropout_train_ratio0": Example(_options(0), ()),
    },
    mistakes=known_in(globals(), Dropout),
)
