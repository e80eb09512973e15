"""Exercise: the layer Convolution."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from exercises.exercise import known_in
from exercises.layer_examples import Example, Letters, numbers
from exercises.layers import layer_exercise
from layers.vision.convolution import Convolution
from netlib.blob import Array, Blob, Blobs


class RoundsUp(Convolution):
    """Convolution rounds the output size down: a window that extends past the edge is omitted. Pooling rounds up."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        sizes = zip(x.shape[self.axis + 1 :], self.pad, self._extent(), self.stride)
        return [-(-(n + 2 * pad - reach) // stride) + 1 for n, pad, reach, stride in sizes]


class ForgetsPadInSize(Convolution):
    """Padding enlarges the image on both sides: H + 2 pad."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        sizes = zip(x.shape[self.axis + 1 :], self._extent(), self.stride)
        return [(n - reach) // stride + 1 for n, reach, stride in sizes]


class PadsOneSide(Convolution):
    """Padding is added on both sides of the image: H + 2 pad, not H + pad."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        sizes = zip(x.shape[self.axis + 1 :], self.pad, self._extent(), self.stride)
        return [(n + pad - reach) // stride + 1 for n, pad, reach, stride in sizes]


class ForgetsDilationInSize(Convolution):
    """A dilated kernel spans dilation (k - 1) + 1 pixels, the value of self._extent(), not k."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        sizes = zip(x.shape[self.axis + 1 :], self.pad, self.kernel, self.stride)
        return [(n + 2 * pad - k) // stride + 1 for n, pad, k, stride in sizes]


class ForgetsOne(Convolution):
    """Count the first window as well: the division gives the number of shifts, so the size is one more."""

    def _outputs(self, i: int, x: Blob) -> list[int]:
        return [max(n - 1, 1) for n in super()._outputs(i, x)]


class Flips(Convolution):
    """The kernel is flipped. Convolution in deep learning is a correlation: w[i, j] multiplies x[h + i, w + j], not
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
    """With group, each group of outputs uses its own group of channels; here all use the first."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        part = self.channels // self.param.group
        first = np.concatenate([bottom[0].data[:, :part]] * self.param.group, axis=1)
        given = Blob(first.shape, first.dtype)
        given.data[...] = first
        super().forward(Blobs([given]), top)


class SwapsStrideAndDilation(Convolution):
    """stride and dilation are exchanged: the window moves by stride (h stride), and its elements are dilation apart
    (i dilation).
    """

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        padded = np.pad(image, [(0, 0), *((p, p + 9) for p in self.pad)])
        patches = np.stack([padded[part] for part in self._swapped(y_shape)], axis=1)
        return patches.reshape(-1, int(np.prod(y_shape[1:])))

    def _swapped(self, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
        for element in np.ndindex(self.kernel):
            steps = zip(element, self.dilation, self.stride, y_shape[1:])
            yield slice(None), *(slice(i * s, i * s + (n - 1) * d + 1, d) for i, d, s, n in steps)


class KeepsLastImage(Convolution):
    """dw and db contain only the last image. They are sums over all images of the batch: use += inside the loop."""

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
    """A pixel that several windows share receives a gradient from each; here only the last is kept. col2im must add,
    with +=.
    """

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        C, *sizes = x_shape
        padded = np.zeros((C, *(n + 2 * p for n, p in zip(sizes, self.pad))), columns.dtype)
        patches = columns.reshape(C, -1, *y_shape[1:])
        for element, part in enumerate(self.window_slices(y_shape)):
            padded[part] = patches[:, element]
        inside = (slice(None), *(slice(p, p + n) for n, p in zip(sizes, self.pad)))
        return padded[inside]


class OverwritesWindows(Convolution):
    """The loop over the windows assigns to dx where it must add: windows overlap, and each contributes, with +=."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, [False], bottom)
        for x, y in zip(bottom, top) if propagate_down[0] else []:
            for n, gradient in enumerate(y.diff):
                columns = self.by_group(self.blobs[0].data).swapaxes(1, 2) @ self.by_group(gradient)
                x.diff[n] = self._last_window(columns, x.shape[1:], gradient.shape)

    def _last_window(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        C, *sizes = x_shape
        padded = np.zeros((C, *(n + 2 * p for n, p in zip(sizes, self.pad))), columns.dtype)
        patches = columns.reshape(C, -1, *y_shape[1:])
        elements = list(np.ndindex(self.kernel))
        for h, w in np.ndindex(*y_shape[1:]):
            for element, (i, j) in enumerate(elements):
                row, column = h * self.stride[0] + i * self.dilation[0], w * self.stride[1] + j * self.dilation[1]
                padded[:, row, column] = patches[:, element, h, w]
        return padded[:, self.pad[0] : self.pad[0] + sizes[0], self.pad[1] : self.pad[1] + sizes[1]]


class Transposes(Convolution):
    """Rows and columns of the kernel are exchanged: w[o, c, i, j] multiplies row h + i and column w + j."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        w = self.weight.data
        kept = w.copy()
        if self.kernel[0] == self.kernel[1]:
            w[...] = kept.swapaxes(-1, -2)
        super().forward(bottom, top)
        w[...] = kept


class RepeatsEdge(Convolution):
    """Outside the image the nearest pixel is used. The padding is 0."""

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        padded = np.pad(image, [(0, 0), *((p, p) for p in self.pad)], mode="edge")
        patches = np.stack([padded[part] for part in self.window_slices(y_shape)], axis=1)
        return patches.reshape(-1, int(np.prod(y_shape[1:])))


class PadsTwice(Convolution):
    """The padding is counted twice: the image is padded, and pad is subtracted from the index as well. In a padded
    image the window starts at h stride.
    """

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        padded = np.pad(image, [(0, 0), *((2 * p, 2 * p) for p in self.pad)])
        patches = np.stack([padded[part] for part in self.window_slices(y_shape)], axis=1)
        return patches.reshape(-1, int(np.prod(y_shape[1:])))


class NoStrideBackward(Convolution):
    """dx ignores the stride: dy[h, w] contributes to row h stride + i dilation - pad, which forward read."""

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        kept, self.stride = self.stride, (1,) * len(self.stride)
        found = super().col2im(columns, x_shape, y_shape)
        self.stride = kept
        return found


class Interleaves(Convolution):
    """The groups are interleaved. Groups are contiguous blocks: group 0 has the first channels and outputs, group 1 the
    next.
    """

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        given = Blob(bottom[0].shape, self.dtype)
        groups = self.param.group
        given.data[...] = np.concatenate([bottom[0].data[:, g::groups] for g in range(groups)], axis=1)
        super().forward(Blobs([given]), top)


class BiasOfLastImage(Convolution):
    """db contains only the last image. It is a sum over all images of the batch: use += inside the loop."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        kept = [blob.diff.copy() for blob in self.blobs[1:]]
        super().backward(top, propagate_down, bottom)
        for blob, before in zip(self.blobs[1:], kept):
            blob.diff[...] = before + top[0].diff[-1].sum(axis=(1, 2))


class BiasMean(Convolution):
    """db is a mean over the output positions. It is a sum: b[o] is added at every position."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        kept = [blob.diff.copy() for blob in self.blobs[1:]]
        super().backward(top, propagate_down, bottom)
        for blob, before in zip(self.blobs[1:], kept):
            blob.diff[...] = before + (blob.diff - before) / np.prod(top[0].shape[2:])


class FlipsBackward(Convolution):
    """dx uses the flipped kernel. Add dy[h, w] w[i, j] to the pixel that w[i, j] multiplies in forward, at
    h stride + i dilation - pad.
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


def _part_of_backward(layer: Convolution, top: Blobs, bottom: Blobs, last_window: bool = False) -> list[Array]:
    """Return dw and db of the last image alone, or of its last window."""
    before = [blob.diff.copy() for blob in layer.blobs]
    x, y = Blob(bottom[0].data[-1:].shape, layer.dtype), Blob(top[0].diff[-1:].shape, layer.dtype)
    x.data[...], y.diff[...] = bottom[0].data[-1:], top[0].diff[-1:]
    if last_window:
        y.diff[...] = 0
        y.diff[..., -1, -1] = top[0].diff[-1:, ..., -1, -1]
    for blob in layer.blobs:
        blob.diff[...] = 0
    Convolution.backward(layer, Blobs([y]), [False], Blobs([x]))
    found = [blob.diff.copy() for blob in layer.blobs]
    for blob, kept in zip(layer.blobs, before):
        blob.diff[...] = kept
    return found


class AssignsWeights(Convolution):
    """dw[...] = inside the loop over the images replaces the sum of the images before, and what earlier batches have
    added. Use dw[...] += there.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        self.weight.diff[...] = _part_of_backward(self, top, bottom)[0]


class AssignsBias(Convolution):
    """db[...] = inside the loop over the images replaces the sum of the images before, and what earlier batches have
    added. Use db[...] += there.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        for blob, found in zip(self.blobs[1:], _part_of_backward(self, top, bottom)[1:]):
            blob.diff[...] = found


class AssignsWeightsByWindow(Convolution):
    """dw is assigned inside the loop over the windows, so only the last window is left. All windows use the same
    weights: add the gradient of each, with +=.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        self.weight.diff[...] = _part_of_backward(self, top, bottom, last_window=True)[0]


class AssignsBiasByWindow(Convolution):
    """db is assigned inside the loop over the windows, so only the last window is left. All windows use the same bias:
    add dy of each, with +=.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        for blob, found in zip(self.blobs[1:], _part_of_backward(self, top, bottom, last_window=True)[1:]):
            blob.diff[...] = found


class OverwritesMapsAndWindows(OverwritesWindows):
    """The loop over output maps and windows assigns to dx where it must add: every map contributes to a pixel, and
    windows overlap. Use +=.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        Convolution.backward(self, top, [False], bottom)
        w = self.by_group(self.weight.data)[:, -1:]
        for x, y in zip(bottom, top) if propagate_down[0] else []:
            for n, gradient in enumerate(y.diff):
                columns = w.swapaxes(1, 2) @ self.by_group(gradient)[:, -1:]
                x.diff[n] = self._last_window(columns.reshape(-1, columns.shape[-1]), x.shape[1:], gradient.shape)


class KeepsPadding(Convolution):
    """dx begins at the corner of the padded image. Cut the padding off: rows pad to pad + H, and columns likewise."""

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        C, *sizes = x_shape
        kept, self.pad = self.pad, (0,) * len(sizes)
        whole = super().col2im(columns, (C, *(n + 2 * p for n, p in zip(sizes, kept))), y_shape)
        self.pad = kept
        inside = (slice(None), *(slice(n) for n in sizes))
        return whole[inside]


def _without_leading_padding(layer: Convolution, image: Array, y_shape: tuple[int, ...]) -> Array:
    padded = np.pad(image, [(0, 0), *((0, 2 * p) for p in layer.pad)])
    patches = np.stack([padded[part] for part in layer.window_slices(y_shape)], axis=1)
    return np.asarray(patches.reshape(-1, int(np.prod(y_shape[1:]))))


class StartsInside(Convolution):
    """The padding before the image is missing: the window of row h begins at row h stride - pad of the image."""

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        return _without_leading_padding(self, image, y_shape)


class StartsInsideBackward(Convolution):
    """dw uses windows without the padding before the image. Use the windows of forward: row h begins at row
    h stride - pad of the image.
    """

    inside = False

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        self.inside = True
        super().backward(top, propagate_down, bottom)
        self.inside = False

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        if self.inside:
            return _without_leading_padding(self, image, y_shape)
        return super().im2col(image, y_shape)


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
        "self.stride and self.kernel have one value per spatial axis, and self._extent() is the span of "
        "the dilated kernel.",
        "forward": "For every x in bottom and y in top: write y.data, the sum over c, i, j of the docstring, plus b. "
        "images(), by_group() and im2col() reduce it to matrix products; plain loops over n, o, h, w are also "
        "correct, but slower.",
        "backward": "Add to self.weight.diff (dw) and self.bias.diff (db), summed over the images; write x.diff "
        "where propagate_down is true. Sum the contributions of windows that share a pixel.",
        "im2col": "Stack the pixels that each kernel element multiplies; window_slices() yields the slices of the "
        "padded image. Leave it unchanged if your forward does not use it.",
        "col2im": "The adjoint of im2col: add every element of the columns to its pixel and crop the padding. "
        "Leave it unchanged if your backward does not use it.",
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
    mistakes=known_in(globals(), Convolution),
)
