"""The exercise pooling: Caffe's rules for windows that hang over."""

from __future__ import annotations

import numpy as np

from exercises.exercise import known
from exercises.layer_examples import Example, Letters
from exercises.layers import layer_exercise
from layers.vision.pooling import Pooling
from netlib.blob import Array, Blobs


def _extent(layer: Pooling, i: int, size: int) -> int:
    return size + 2 * layer.pad[i] - layer.whole_kernel[i]


class RoundsDown(Pooling):
    """Caffe's pooling rounds its size up, not down: a last window may hang over the edge."""

    def _outputs(self, i: int, size: int) -> int:
        count = _extent(self, i, size) // self.stride[i] + 1
        return count - (any(self.pad) and (count - 1) * self.stride[i] >= size + self.pad[i])


class IgnoresRoundMode(Pooling):
    """The option round_mode is left out: with FLOOR the size is rounded down."""

    def _outputs(self, i: int, size: int) -> int:
        count = -(-_extent(self, i, size) // self.stride[i]) + 1
        return count - (any(self.pad) and (count - 1) * self.stride[i] >= size + self.pad[i])


class KeepsLastWindow(Pooling):
    """With padding, a last window that starts beyond the image sees no pixel and is dropped."""

    def _outputs(self, i: int, size: int) -> int:
        extent = _extent(self, i, size)
        return (-(-extent // self.stride[i]) if self.param.round_mode == "CEIL" else extent // self.stride[i]) + 1


class DropsAlways(Pooling):
    """A last window is dropped only if it starts beyond the image and the padding before it: where (count - 1) stride
    >= size + pad, with the start counted from the padding on.
    """

    def _outputs(self, i: int, size: int) -> int:
        extent = _extent(self, i, size)
        count = (-(-extent // self.stride[i]) if self.param.round_mode == "CEIL" else extent // self.stride[i]) + 1
        return count - (any(self.pad) and (count - 1) * self.stride[i] >= size)


class ZeroCanWin(Pooling):
    """The padding of a maximum must never win, and 0 is more than a negative number: pad with -infinity."""

    def padded(self, x: Array, y_shape: tuple[int, ...], value: float) -> Array:
        return super().padded(x, y_shape, 0)


class CountsWhatHangsOver(Pooling):
    """The mean divides by the kernel's whole area. What hangs over the padded image is not counted; area() gives what
    is.
    """

    def area(self, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        return np.full(y_shape[2:], float(np.prod(self.kernel)), self.dtype)


class CountsNoPadding(Pooling):
    """The mean divides by the number of pixels. Caffe counts the padding, too (PyTorch's count_include_pad); area()
    gives its number.
    """

    def area(self, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        sizes = []
        for i in range(2):
            start = np.arange(y_shape[2 + i]) * self.stride[i] - self.pad[i]
            sizes.append(np.minimum(start + self.kernel[i], x_shape[2 + i]) - np.maximum(start, 0))
        return np.outer(*sizes).astype(self.dtype)


class ForgetsAreaBackward(Pooling):
    """backward of the mean does not divide: each pixel of a window gets dy / area."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not self.is_max:
            kept = top[0].diff.copy()
            top[0].diff[...] *= self.area(bottom[0].shape, top[0].shape)
            super().backward(top, propagate_down, bottom)
            top[0].diff[...] = kept
        else:
            super().backward(top, propagate_down, bottom)


class LastOfEqual(Pooling):
    """Of equal values the first one wins, row by row; yours takes the last. Use >, and not >=, if you walk through the
    window.
    """

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        if self.is_max:
            for n, x in enumerate(bottom[0].data):
                windows = self.windows(self.padded(x, top[0].shape, -np.inf), top[0].shape)
                self.winners[n] = len(windows) - 1 - windows[::-1].argmax(axis=0)
                if len(top) > 1:
                    top[1].data[n] = self._index(n, x.shape[2])


class PlaceInWindow(Pooling):
    """The mask says where in the map a winner stands, h W + w, and not where in its window."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        if len(top) > 1:
            top[1].data[...] = self.winners


class AllOfEqual(Pooling):
    """Of equal values only the first gets the gradient; yours gives it to all of them. Remember in forward which one
    won.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not self.is_max:
            super().backward(top, propagate_down, bottom)
            return
        for n, x in enumerate(bottom[0].data):
            shape = top[0].shape
            source, target = self.padded(x, shape, -np.inf), self.padded(np.zeros_like(x), shape, 0)
            for rows, across in self.places(shape):
                target[:, rows, across] += top[0].diff[n] * (source[:, rows, across] == top[0].data[n])
            p, q = self.pad
            bottom[0].diff[n] = target[:, p : p + x.shape[1], q : q + x.shape[2]]


class OverwritesShared(Pooling):
    """A pixel that wins in several windows gets the gradient of each; yours keeps one. An array of indices on the left
    of += does not add twice: np.add.at does.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not self.is_max:
            super().backward(top, propagate_down, bottom)
            return
        (c, h, w), (sh, sw) = np.indices(top[0].shape[1:]), self.stride
        for n, x in enumerate(bottom[0].data):
            target = self.padded(np.zeros_like(x), top[0].shape, 0)
            i, j = np.divmod(self.winners[n], self.kernel[1])
            target[c, h * sh + i, w * sw + j] = top[0].diff[n]
            p, q = self.pad
            bottom[0].diff[n] = target[:, p : p + x.shape[1], q : q + x.shape[2]]


def _different(*shape: int, seed: int = 0) -> Array:
    """Numbers far apart from each other, most of them negative."""
    count = int(np.prod(shape))
    return np.asarray(np.random.default_rng(seed).permutation(count).reshape(shape) / 7.0 - count / 9)


def _options(more: str) -> str:
    return f"pooling_param {{ {more} }}"


TIES = np.random.default_rng(5).integers(0, 3, (1, 1, 5, 5)).astype(float)

EXERCISE = layer_exercise(
    "pooling",
    "Pooling",
    title="Pooling: the maximum or the mean of a window",
    chapter=4,
    file="layers/vision/pooling.py",
    to_do={
        "_outputs": "Return the size of the output in direction i (0 down, 1 across) for an input of this size: round "
        "up unless self.param.round_mode is FLOOR; with padding in either direction, any(self.pad), drop a last window "
        "that starts beyond the image. The kernel is self.whole_kernel[i]. (Ours also says if no window is left.)",
        "forward": "Write top[0].data, and the mask into top[1].data if there is one. self.is_max tells MAX from AVE. "
        "Keep what backward needs, as self.winners. padded(), windows(), _index() and area() help.",
        "backward": "If propagate_down[0], write every element of bottom[0].diff: what several windows share "
        "is summed, what no window took is 0.",
    },
    shaped_by="_outputs",
    letters=Letters(("x",), ("y", "mask"), axes={"x": "nchw", "y": "nchw", "mask": "nchw"}),
    examples=[
        Example(_options("kernel_size: 2 stride: 2"), (_different(2, 2, 5, 4),)),
        Example(_options("kernel_size: 3 stride: 2 pad: 1"), (_different(1, 2, 5, 6, seed=1),)),
        Example(_options("kernel_size: 2 stride: 2 pad: 1"), (_different(1, 1, 5, 5, seed=7),)),
        Example(_options("kernel_size: 3"), (_different(1, 1, 5, 5, seed=2),), note="windows that overlap"),
        Example(_options("kernel_size: 2 stride: 2 round_mode: FLOOR"), (_different(1, 1, 5, 5, seed=3),)),
        Example(_options("global_pooling: true"), (_different(1, 2, 3, 4, seed=4),)),
        Example(_options("kernel_size: 3 stride: 2"), (TIES,), tops=2, gradient=False, note="a mask, equal values"),
        Example(_options("pool: AVE kernel_size: 2 stride: 2"), (_different(2, 1, 5, 4, seed=5),)),
        Example(_options("pool: AVE kernel_size: 3 stride: 2 pad: 1"), (_different(1, 2, 5, 6, seed=6),)),
    ],
    from_caffe={
        "pool_MAX_k3s2p1_odd": Example(_options("kernel_size: 3 stride: 2 pad: 1"), ()),
        "pool_MAX_k2s2_odd": Example(_options("kernel_size: 2 stride: 2"), ()),
        "pool_MAX_ties": Example(_options("kernel_size: 3 stride: 2"), ()),
        "pool_AVE_k3s2p1_odd": Example(_options("pool: AVE kernel_size: 3 stride: 2 pad: 1"), ()),
        "pool_AVE_k2s2_odd": Example(_options("pool: AVE kernel_size: 2 stride: 2"), ()),
    },
    mistakes=known(
        RoundsDown,
        IgnoresRoundMode,
        KeepsLastWindow,
        DropsAlways,
        ZeroCanWin,
        CountsWhatHangsOver,
        CountsNoPadding,
        ForgetsAreaBackward,
        LastOfEqual,
        PlaceInWindow,
        AllOfEqual,
        OverwritesShared,
    ),
)  # fmt: skip
