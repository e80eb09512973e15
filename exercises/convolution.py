"""The exercise convolution."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from exercises.exercise import known
from exercises.layer_examples import Example, Letters, numbers
from exercises.layers import layer_exercise
from layers.vision.convolution import Convolution
from netlib.blob import Array, Blob, Blobs


class RoundsUp(Convolution):
    """A convolution rounds its size down: a window that would hang over the edge is left out. It is pooling that
    rounds up.
    """

    def _outputs(self, i: int, x: Blob) -> list[int]:
        sizes = zip(x.shape[self.axis + 1 :], self.pad, self._reach(), self.stride)
        return [-(-(n + 2 * pad - reach) // stride) + 1 for n, pad, reach, stride in sizes]


class ForgetsPadInSize(Convolution):
    """The padding makes the image larger on both sides: H + 2 pad."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        sizes = zip(x.shape[self.axis + 1 :], self._reach(), self.stride)
        return [(n - reach) // stride + 1 for n, reach, stride in sizes]


class PadsOneSide(Convolution):
    """There is padding on both sides of the image: H + 2 pad, and not H + pad."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        sizes = zip(x.shape[self.axis + 1 :], self.pad, self._reach(), self.stride)
        return [(n + pad - reach) // stride + 1 for n, pad, reach, stride in sizes]


class ForgetsDilationInSize(Convolution):
    """A spread kernel reaches dilation (k - 1) + 1 pixels far, which self._reach() gives, and not k."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        sizes = zip(x.shape[self.axis + 1 :], self.pad, self.kernel, self.stride)
        return [(n + 2 * pad - k) // stride + 1 for n, pad, k, stride in sizes]


class ForgetsOne(Convolution):
    """Count the first window, too: the division says how often the kernel can move on, so the size is one more."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        return [max(n - 1, 1) for n in super()._outputs(i, x)]


class Flips(Convolution):
    """The kernel is turned around. Deep learning's convolution is a correlation: w[i, j] meets x[h + i, w + j], and not
    x[h - i, w - j].
    """

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        w = self.blobs[0].data
        kept = w.copy()
        w[...] = kept[..., ::-1, ::-1]
        super().forward(bottom, top)
        w[...] = kept


class NoBias(Convolution):
    """The bias is missing: b[o] is added to every pixel of the output map o."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        if self.param.bias_term:
            for y in top:
                y.data[...] -= self.blobs[1].data.reshape(-1, 1, 1)


class MixesGroups(Convolution):
    """With group, each part of the outputs sees its own part of the channels; yours all see the first part."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        part = self.channels // self.param.group
        first = np.concatenate([bottom[0].data[:, :part]] * self.param.group, axis=1)
        given = Blob(first.shape, first.dtype)
        given.data[...] = first
        super().forward(Blobs([given]), top)


class SwapsStrideAndDilation(Convolution):
    """stride and dilation are exchanged: the window moves by stride, h stride, and its elements are dilation apart, i
    dilation.
    """

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        padded = np.pad(image, [(0, 0), *((p, p + 9) for p in self.pad)])
        met = np.stack([padded[part] for part in self._swapped(y_shape)], axis=1)
        return met.reshape(-1, int(np.prod(y_shape[1:])))

    def _swapped(self, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
        for element in np.ndindex(self.kernel):
            steps = zip(element, self.dilation, self.stride, y_shape[1:])
            yield slice(None), *(slice(i * s, i * s + (n - 1) * d + 1, d) for i, d, s, n in steps)


class KeepsLastImage(Convolution):
    """dw and db are those of the last image alone. They are sums over all images of the batch: += inside the loop."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        before = [blob.diff.copy() for blob in self.blobs]
        super().backward(top, propagate_down, bottom)
        for blob, kept in zip(self.blobs, before):
            blob.diff[...] = kept
        dy = top[0].diff[-1:]
        x, y = Blob(bottom[0].data[-1:].shape, self.dtype), Blob(dy.shape, self.dtype)
        x.data[...], y.diff[...] = bottom[0].data[-1:], dy
        super().backward(Blobs([y]), [False], Blobs([x]))


class OverwritesShared(Convolution):
    """Pixels that several windows share get a gradient from each of them; yours keeps that of the last. col2im has to
    add, with +=.
    """

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        C, *sizes = x_shape
        padded = np.zeros((C, *(n + 2 * p for n, p in zip(sizes, self.pad))), columns.dtype)
        met = columns.reshape(C, -1, *y_shape[1:])
        for element, part in enumerate(self.places(y_shape)):
            padded[part] = met[:, element]
        inside = (slice(None), *(slice(p, p + n) for n, p in zip(sizes, self.pad)))
        return padded[inside]


class OverwritesWindows(Convolution):
    """Your loop over the windows writes dx where it has to add: windows overlap, and each of them adds its part to what
    the ones before have left, with +=.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, [False], bottom)
        for x, y in zip(bottom, top) if propagate_down[0] else []:
            for n, gradient in enumerate(y.diff):
                columns = self.by_group(self.blobs[0].data).swapaxes(1, 2) @ self.by_group(gradient)
                x.diff[n] = self._last_window(columns, x.shape[1:], gradient.shape)

    def _last_window(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        C, *sizes = x_shape
        padded = np.zeros((C, *(n + 2 * p for n, p in zip(sizes, self.pad))), columns.dtype)
        met = columns.reshape(C, -1, *y_shape[1:])
        elements = list(np.ndindex(self.kernel))
        for h, w in np.ndindex(*y_shape[1:]):
            for element, (i, j) in enumerate(elements):
                row, column = h * self.stride[0] + i * self.dilation[0], w * self.stride[1] + j * self.dilation[1]
                padded[:, row, column] = met[:, element, h, w]
        return padded[:, self.pad[0] : self.pad[0] + sizes[0], self.pad[1] : self.pad[1] + sizes[1]]


class Transposes(Convolution):
    """Rows and columns of the kernel are exchanged: w[o, c, i, j] meets row h + i and column w + j."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        w = self.weight.data
        kept = w.copy()
        if self.kernel[0] == self.kernel[1]:
            w[...] = kept.swapaxes(-1, -2)
        super().forward(bottom, top)
        w[...] = kept


class RepeatsEdge(Convolution):
    """Outside of the image the nearest pixel is taken. The padding is 0."""

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        padded = np.pad(image, [(0, 0), *((p, p) for p in self.pad)], mode="edge")
        met = np.stack([padded[part] for part in self.places(y_shape)], axis=1)
        return met.reshape(-1, int(np.prod(y_shape[1:])))


class PadsTwice(Convolution):
    """The padding is counted twice: the image is padded, and pad is subtracted from the index as well. In a padded
    image the window begins at h stride.
    """

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        padded = np.pad(image, [(0, 0), *((2 * p, 2 * p) for p in self.pad)])
        met = np.stack([padded[part] for part in self.places(y_shape)], axis=1)
        return met.reshape(-1, int(np.prod(y_shape[1:])))


class NoStrideBackward(Convolution):
    """dx leaves the stride out: dy[h, w] goes back to row h stride + i dilation - pad, where forward read."""

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        kept, self.stride = self.stride, (1,) * len(self.stride)
        found = super().col2im(columns, x_shape, y_shape)
        self.stride = kept
        return found


class Interleaves(Convolution):
    """The groups are interleaved. Group 0 has the first channels and the first outputs, group 1 the next: blocks, and
    not every second one.
    """

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        given = Blob(bottom[0].shape, self.dtype)
        groups = self.param.group
        given.data[...] = np.concatenate([bottom[0].data[:, g::groups] for g in range(groups)], axis=1)
        super().forward(Blobs([given]), top)


class BiasOfLastImage(Convolution):
    """db is that of the last image alone. It is a sum over all images of the batch: += inside the loop."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        kept = [blob.diff.copy() for blob in self.blobs[1:]]
        super().backward(top, propagate_down, bottom)
        for blob, before in zip(self.blobs[1:], kept):
            blob.diff[...] = before + top[0].diff[-1].sum(axis=(1, 2))


class BiasMean(Convolution):
    """db is a mean over the places of the output. It is a sum: b[o] is added at each of them."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        kept = [blob.diff.copy() for blob in self.blobs[1:]]
        super().backward(top, propagate_down, bottom)
        for blob, before in zip(self.blobs[1:], kept):
            blob.diff[...] = before + (blob.diff - before) / np.prod(top[0].shape[2:])


class FlipsBackward(Convolution):
    """dx uses the kernel turned around. Add dy[h, w] w[i, j] to the very pixel that w[i, j] met in forward, h stride +
    i dilation - pad.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, [False], bottom)
        before = [blob.diff.copy() for blob in self.blobs]
        w = self.blobs[0].data
        kept = w.copy()
        w[...] = kept[..., ::-1, ::-1]
        super().backward(top, propagate_down, bottom)
        w[...] = kept
        for blob, diff in zip(self.blobs, before):
            blob.diff[...] = diff


def _options(outputs: int, more: str) -> str:
    return f"convolution_param {{ num_output: {outputs} {more} }}"


EXERCISE = layer_exercise(
    "convolution",
    "Convolution",
    title="Convolution: a small kernel slides over the image",
    chapter=3,
    file="layers/vision/convolution.py",
    to_do={
        "_outputs": "Return [Ho, Wo] for the shape of x: its spatial axes begin at self.axis + 1. self.pad, "
        "self.stride and self.kernel have a number for each of them, and self._reach() is how far "
        "the spread kernel reaches.",
        "forward": "For every x in bottom and y in top: write y.data, the sum over c, i, j of the docstring, plus b. "
        "images(), by_group() and im2col() make three matrix products of it; plain loops over n, o, h, w are as "
        "good, and slower.",
        "backward": "Add to self.weight.diff (dw) and self.bias.diff (db), summed over the images; write x.diff "
        "where propagate_down says so. What several windows share is summed.",
        "im2col": "Stack what each kernel element meets; places() gives the parts of the padded image. "
        "Leave it as it is if your forward does not need it.",
        "col2im": "The way back: add every element of the columns where its pixel came from, and cut off the padding. "
        "Leave it as it is if your backward does not need it.",
    },
    shaped_by="_outputs",
    letters=Letters(("x",), ("y",), ("w", "b"), {"x": "nchw", "y": "nohw", "w": "ocij", "b": "o"}),
    examples=[
        Example(_options(2, "kernel_size: 3"), (numbers(2, 2, 4, 5),)),
        Example(_options(2, "kernel_h: 2 kernel_w: 3 stride: 2 pad: 2"), (numbers(2, 1, 4, 6, seed=1),)),
        Example(_options(4, "kernel_size: 2 group: 2"), (numbers(1, 4, 3, 4, seed=2),)),
        Example(_options(1, "kernel_size: 2 dilation: 2 bias_term: false"), (numbers(2, 1, 5, 4, seed=3),)),
    ],
    from_caffe={
        "conv_k3_s2_p1": Example(_options(6, "kernel_size: 3 stride: 2 pad: 1"), ()),
        "conv_group2": Example(_options(6, "kernel_size: 3 pad: 1 group: 2"), ()),
        "conv_dil2_p2_s2": Example(_options(6, "kernel_size: 3 dilation: 2 pad: 2 stride: 2"), ()),
    },
    mistakes=known(
        RoundsUp,
        ForgetsPadInSize,
        PadsOneSide,
        ForgetsDilationInSize,
        ForgetsOne,
        Flips,
        NoBias,
        MixesGroups,
        SwapsStrideAndDilation,
        KeepsLastImage,
        OverwritesShared,
        OverwritesWindows,
        Transposes,
        RepeatsEdge,
        PadsTwice,
        NoStrideBackward,
        Interleaves,
        BiasOfLastImage,
        BiasMean,
        FlipsBackward,
    ),
)  # fmt: skip
