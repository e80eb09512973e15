"""Exercise: the layer Split, one blob with several consumers."""

from __future__ import annotations

from exercises.exercise import known_in
from exercises.layer_examples import Example, Letters, numbers
from exercises.layers import layer_exercise
from layers.common.split import Split
from netlib.blob import Blobs


class ShapesOne(Split):
    """Reshape every top, not only the first: for y in top."""

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)


class WritesOne(Split):
    """Copy into every top, not only the first: for y in top."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = bottom[0].data


class Divides(Split):
    """x is not divided among the consumers: each gets all of it."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for y in top:
            y.data[...] = bottom[0].data / len(top)


class TakesLast(Split):
    """dx contains only the gradient of the last top: every iteration of the loop overwrites the previous one. L depends
    on x through all tops, so their gradients are summed.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        for y in top:
            bottom[0].diff[...] = y.diff


class TakesFirst(Split):
    """dx contains only the gradient of the first top. L depends on x through all tops, so sum their gradients."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        bottom[0].diff[...] = top[0].diff


class Means(Split):
    """dx is the mean of the gradients. By the chain rule it is their sum."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        bottom[0].diff[...] /= len(top)


class CountsFirstTwice(Split):
    """The gradient of the first top is counted twice: it is assigned first, then added with the others."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        bottom[0].diff[...] += top[0].diff


class TwoOnly(Split):
    """Only two gradients are summed; there may be any number: loop over top."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        bottom[0].diff[...] = top[0].diff + top[1].diff


EXERCISE = layer_exercise(
    "split",
    "Split",
    title="Split: one blob for several consumers",
    chapter=5,
    file="layers/common/split.py",
    to_do={
        "reshape": "Give every top the shape of bottom[0].",
        "forward": "Copy bottom[0].data into every top.",
        "backward": "If propagate_down[0], write bottom[0].diff: the sum of the diffs of all tops. It contains "
        "old values, so assign the first and add the others.",
    },
    letters=Letters(("x",), ("y_0", "y_1", "y_2"), axes={"x": "nc", "y_0": "nc", "y_1": "nc", "y_2": "nc"}),
    examples=[
        Example("", (numbers(2, 3),), tops=2, note="2 tops"),
        Example("", (numbers(3, 2, seed=1),), tops=3, note="3 tops"),
    ],
    from_caffe={"split_explicit": Example("", (), tops=3)},
    mistakes=known_in(globals(), Split),
)
