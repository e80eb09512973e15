"""Exercise: the layer Convolution."""

from __future__ import annotations

from exercises.exercise import Mistake
from exercises.layers import Example, Letters, Option, layer_exercise, numbers

ADD_WEIGHTS = "dw += dy @ self.by_group(self.im2col(image, gradient.shape)).swapaxes(1, 2)"
ADD_BIAS = "self.bias.diff[...] += dy.sum(axis=2).reshape(-1)"
STAMP = "self.images(x.diff)[n] = self.col2im(w.swapaxes(1, 2) @ dy, image.shape, gradient.shape)"
STAMP_WINDOWS = """x.diff[n] = 0
for h, v in np.ndindex(gradient.shape[1:]):
    stamp = np.tensordot(gradient[:, h, v], self.weight.data, 1)
    x.diff[n, :, h : h + self.kernel[0], v : v + self.kernel[1]] = stamp"""
STAMP_MAPS_AND_WINDOWS = """x.diff[n] = 0
for o, h, v in np.ndindex(gradient.shape):
    stamp = gradient[o, h, v] * self.weight.data[o]
    x.diff[n, :, h : h + self.kernel[0], v : v + self.kernel[1]] = stamp"""

WINDOW_NOT_COUNTED = Mistake(
    "Count the first window as well: the division gives the number of shifts, so the size is one more.",
    ("(n + 2 * pad - extent) // stride + 1", "(n + 2 * pad - extent) // stride"),
)
BIAS_MISSING = Mistake(
    "The bias is missing: b[o] is added to every pixel of the output map o.",
    ("out += self.bias.data.reshape(-1, *(1,) * len(self.kernel))", "out += 0"),
)
DX_ASSIGNED = Mistake(
    "dx is assigned in a loop where it must be added to: windows overlap, and every output map contributes to "
    "a pixel. Start from zeros and use +=.",
    ("padded[part] += patches[:, element]", "padded[part] = patches[:, element]"),
    (STAMP, STAMP_WINDOWS),
    (STAMP, STAMP_MAPS_AND_WINDOWS),
)
GRADIENTS_ASSIGNED = Mistake(
    "A gradient of a parameter is assigned in a loop over images or windows, so only the last one is left, "
    "without what earlier batches have added. Use dw[...] += and db[...] += there.",
    (
        ADD_WEIGHTS,
        "dw[...] = dy @ self.by_group(self.im2col(image, gradient.shape)).swapaxes(1, 2)",
    ),
    (
        ADD_WEIGHTS,
        "columns = self.by_group(self.im2col(image, gradient.shape))\n"
        "dw[...] = dy[..., -1:] @ columns[..., -1:].swapaxes(1, 2)",
    ),
    (ADD_BIAS, "self.bias.diff[...] = dy.sum(axis=2).reshape(-1)"),
    (ADD_BIAS, "self.bias.diff[...] = dy[..., -1].reshape(-1)"),
)
DX_NOT_CROPPED = Mistake(
    "dx begins at the corner of the padded image. Cut the padding off: rows pad to pad + H, and columns "
    "likewise.",
    ("slice(p, p + n)", "slice(n)"),
)
MISTAKES = (WINDOW_NOT_COUNTED, BIAS_MISSING, DX_ASSIGNED, GRADIENTS_ASSIGNED, DX_NOT_CROPPED)

TO_DO = {
    "_outputs": "Return [Ho, Wo] for the shape of x: its spatial axes begin at self.axis + 1. self.pad, "
    "self.stride and self.kernel have one value per spatial axis, and self._extent() is the span of "
    "the dilated kernel.",
    "forward": "For every x in bottom and y in top: write y.data, the sum over c, i, j of the docstring, plus b. "
    "images(), by_group() and im2col() reduce it to matrix products; plain loops over n, o, h, w are also "
    "correct, but slower. Begin without options, the check adds one after the other.",
    "backward": "Add to self.weight.diff (dw) and self.bias.diff (db), summed over the images; write x.diff "
    "where propagate_down is true. Sum the contributions of windows that share a pixel.",
    "im2col": "Stack the pixels that each kernel element multiplies; window_slices() yields the slices of the "
    "padded image. Leave it unchanged if your forward does not use it.",
    "col2im": "The adjoint of im2col: add every element of the columns to its pixel and crop the padding. "
    "Leave it unchanged if your backward does not use it.",
}
LETTERS = Letters(
    {"x": "n c h w", "x_1": "n c h w"},
    {"y": "n o h w", "y_1": "n o h w"},
    {"w": "o c i j", "b": "o"},
)
BOTTOMS = numbers(2, 2, 4, 5), numbers(2, 2, 5, 4)
EXAMPLES = (
    Example("num_output: 2 kernel_size: 3", BOTTOMS, tops=2),
    Example("num_output: 6 kernel_size: 3", caffe="conv_k3"),
)
NO_BIAS = Option(
    "bias_term: false",
    "There is no self.bias then: use it only if self.param.bias_term.",
    Example("num_output: 2 kernel_size: 3 bias_term: false", (numbers(2, 2, 4, 5),)),
)
RECTANGLE = Option(
    "kernel_h: 2 kernel_w: 3",
    "self.kernel is (kh, kw), and so are the last two axes of w: height and width may differ.",
    Example("num_output: 2 kernel_h: 2 kernel_w: 3", (numbers(2, 2, 4, 5),)),
)
STRIDE = Option(
    "stride_h: 2 stride_w: 3",
    "The window of output row h begins at row h stride, in forward and backward, and only whole windows "
    "count: Ho = (H - kh) // stride + 1. self.stride, like self.pad and self.dilation, is (down, across).",
    Example(
        "num_output: 2 kernel_h: 2 kernel_w: 3 stride_h: 2 stride_w: 3", (numbers(2, 2, 7, 7),)
    ),
)
PAD = Option(
    "pad_h: 1 pad_w: 2",
    "The window of output row h begins at row h - pad, and outside the image x is 0: pad the image on both "
    "sides, and cut the padding off dx (rows pad to pad + H).",
    Example("num_output: 2 kernel_h: 2 kernel_w: 3 pad_h: 1 pad_w: 2", (numbers(2, 2, 4, 5),)),
)
DILATION = Option(
    "dilation: 2 dilation: 3",
    "Element i of the kernel multiplies row h + i dilation, so the kernel spans dilation (kh - 1) + 1 "
    "rows, the value of self._extent().",
    Example(
        "num_output: 2 kernel_h: 2 kernel_w: 3 dilation: 2 dilation: 3", (numbers(2, 2, 5, 8),)
    ),
)
GROUP = Option(
    "group: 2",
    "Each group of outputs sums over its own C / group channels, and w has only that number. Groups are "
    "contiguous: group 0 has the first channels and the first outputs.",
    Example("num_output: 4 kernel_h: 2 kernel_w: 3 group: 2", (numbers(2, 4, 3, 4, seed=5),)),
)
ALL = Option(
    "a combination of options",
    "Output row h and kernel element i meet at row h stride + i dilation - pad of the image, in both passes.",
    Example(
        "num_output: 2 kernel_h: 2 kernel_w: 3 stride_h: 2 stride_w: 1 pad_h: 0 pad_w: 2 dilation: 1 dilation: 2",
        (numbers(2, 1, 4, 6, seed=6),),
    ),
    Example("num_output: 6 kernel_size: 3 stride: 2 pad: 1", caffe="conv_k3_s2_p1"),
    Example("num_output: 6 kernel_size: 3 pad: 1 group: 2", caffe="conv_group2"),
    Example("num_output: 6 kernel_size: 3 dilation: 2 pad: 2 stride: 2", caffe="conv_dil2_p2_s2"),
)

OPTIONS = (NO_BIAS, RECTANGLE, STRIDE, PAD, DILATION, GROUP, ALL)

EXERCISE = layer_exercise(
    "Convolution",
    title="Convolution: a small kernel slides over the image",
    chapter=3,
    block="convolution_param",
    to_do=TO_DO,
    shaped_by="_outputs",
    letters=LETTERS,
    examples=EXAMPLES,
    options=OPTIONS,
    mistakes=MISTAKES,
)
