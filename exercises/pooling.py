"""Exercise: the layer Pooling, with Caffe's rules for windows that extend past the edge."""

from __future__ import annotations

import numpy as np

from exercises.exercise import known_in
from exercises.layer_examples import Example, Letters
from exercises.layers import layer_exercise
from layers.vision.pooling import Pooling
from netlib.blob import Array, Blobs


def _extent(layer: Pooling, i: int, size: int) -> int:
    return size + 2 * layer.pad[i] - layer.whole_kernel[i]


class RoundsDown(Pooling):
    """Caffe's pooling rounds the output size up, not down: the last window may extend past the edge."""

    def _outputs(self, i: int, size: int) -> int:
        count = _extent(self, i, size) // self.stride[i] + 1
        return count - (any(self.pad) and (count - 1) * self.stride[i] >= size + self.pad[i])


class IgnoresRoundMode(Pooling):
    """The option round_mode is ignored: with FLOOR the size is rounded down."""

    def _outputs(self, i: int, size: int) -> int:
        count = -(-_extent(self, i, size) // self.stride[i]) + 1
        return count - (any(self.pad) and (count - 1) * self.stride[i] >= size + self.pad[i])


class KeepsLastWindow(Pooling):
    """With padding, a last window that starts beyond the image covers no pixel and is dropped."""

    def _outputs(self, i: int, size: int) -> int:
        extent = _extent(self, i, size)
        return (-(-extent // self.stride[i]) if self.param.round_mode == "CEIL" else extent // self.stride[i]) + 1


class DropsAlways(Pooling):
    """The last window is dropped only if it starts beyond the image and the leading padding: (count - 1) stride >= size
    + pad, with the start measured from the edge of the padding.
    """

    def _outputs(self, i: int, size: int) -> int:
        extent = _extent(self, i, size)
        count = (-(-extent // self.stride[i]) if self.param.round_mode == "CEIL" else extent // self.stride[i]) + 1
        return count - (any(self.pad) and (count - 1) * self.stride[i] >= size)


class ZeroCanWin(Pooling):
    """The padding must never be the maximum, and 0 exceeds negative values: pad with -infinity."""

    def padded(self, x: Array, y_shape: tuple[int, ...], value: float) -> Array:
        return super().padded(x, y_shape, 0)


class CountsWhatHangsOver(Pooling):
    """The mean divides by the whole kernel area. The part of a window outside the padded image is not counted; area()
    returns the number of counted elements.
    """

    def area(self, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        return np.full(y_shape[2:], float(np.prod(self.kernel)), self.dtype)


class CountsNoPadding(Pooling):
    """The mean divides by the number of pixels. Caffe also counts the padding (PyTorch's count_include_pad); area()
    returns the number.
    """

    def area(self, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        sizes = []
        for i in range(2):
            start = np.arange(y_shape[2 + i]) * self.stride[i] - self.pad[i]
            sizes.append(np.minimum(start + self.kernel[i], x_shape[2 + i]) - np.maximum(start, 0))
        return np.outer(*sizes).astype(self.dtype)


class ForgetsAreaBackward(Pooling):
    """backward of AVE does not divide: each pixel of a window gets dy / area."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not self.is_max:
            kept = top[0].diff.copy()
            top[0].diff[...] *= self.area(bottom[0].shape, top[0].shape)
            super().backward(top, propagate_down, bottom)
            top[0].diff[...] = kept
        else:
            super().backward(top, propagate_down, bottom)


class LastOfEqual(Pooling):
    """Of equal maxima the first in row-major order is selected; here it is the last. In a loop over the window use >,
    not >=.
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
    """The mask holds the index of a maximum in the map, h W + w, not its index in the window."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        if len(top) > 1:
            top[1].data[...] = self.winners


class AllOfEqual(Pooling):
    """Of equal maxima only the first receives the gradient; here all do. Store in forward which one was selected."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not self.is_max:
            super().backward(top, propagate_down, bottom)
            return
        for n, x in enumerate(bottom[0].data):
            shape = top[0].shape
            source, target = self.padded(x, shape, -np.inf), self.padded(np.zeros_like(x), shape, 0)
            for rows, across in self.window_slices(shape):
                target[:, rows, across] += top[0].diff[n] * (source[:, rows, across] == top[0].data[n])
            p, q = self.pad
            bottom[0].diff[n] = target[:, p : p + x.shape[1], q : q + x.shape[2]]


class OverwritesShared(Pooling):
    """A pixel that is the maximum of several windows receives the gradient of each; here only one is kept. += with an
    array of indices adds only once per index: use np.add.at.
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


class OverwritesMeans(Pooling):
    """The loop over the windows of AVE assigns to dx where it must add: windows overlap, and a pixel receives a share
    of each. Use +=.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        if self.is_max:
            return
        (kh, kw), (sh, sw), (p, q) = self.kernel, self.stride, self.pad
        for n, x in enumerate(bottom[0].data):
            target = self.padded(np.zeros_like(x), top[0].shape, 0)
            share = top[0].diff[n] / self.area(bottom[0].shape, top[0].shape)
            for h, w in np.ndindex(*share.shape[1:]):
                target[:, h * sh : h * sh + kh, w * sw : w * sw + kw] = share[:, h, w, None, None]
            bottom[0].diff[n] = target[:, p : p + x.shape[1], q : q + x.shape[2]]


class KeepsPadding(Pooling):
    """dx begins at the corner of the padded image. Cut the padding off: rows pad to pad + H, and columns likewise."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        (c, h, w), (sh, sw) = np.indices(top[0].shape[1:]), self.stride
        for n, x in enumerate(bottom[0].data):
            target = self.padded(np.zeros_like(x), top[0].shape, 0)
            if self.is_max:
                i, j = np.divmod(self.winners[n], self.kernel[1])
                np.add.at(target, (c, h * sh + i, w * sw + j), top[0].diff[n])
            else:
                for rows, across in self.window_slices(top[0].shape):
                    target[:, rows, across] += top[0].diff[n] / self.area(bottom[0].shape, top[0].shape)
            bottom[0].diff[n] = target[:, : x.shape[1], : x.shape[2]]


class StartsInside(Pooling):
    """The padding before the image is missing: the window of row h begins at row h stride - pad of the image."""

    def padded(self, x: Array, y_shape: tuple[int, ...], value: float) -> Array:
        return np.roll(super().padded(x, y_shape, value), (-self.pad[0], -self.pad[1]), (1, 2))


def _different(*shape: int, seed: int = 0) -> Array:
    """Return well-separated values, most of them negative."""
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
        "that starts beyond the image. The kernel is self.whole_kernel[i]. (The project's layer also raises "
        "an error if no window is left.)",
        "forward": "Write top[0].data, and the mask into top[1].data if there is one. self.is_max is true for MAX. "
        "Store what backward needs, as self.winners. padded(), windows(), _index() and area() help.",
        "backward": "If propagate_down[0], write every element of bottom[0].diff: sum the contributions of windows "
        "that share a pixel; pixels of no window are 0.",
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
    mistakes=known_in(globals(), Pooling),
)
