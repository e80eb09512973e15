"""Exercise: the layer Pooling, with Caffe's rules for windows that extend past the edge."""

from __future__ import annotations

import numpy as np

from exercises.exercise import Mistake
from exercises.layers import Example, Letters, layer_exercise
from netlib.blob import Array

ADD_MAX = "np.add.at(padded, (c, h * sh + i, w * sw + j), dy[n])"
ADD_MEANS = """for rows, across in self.window_slices(dy.shape):
    padded[:, rows, across] += share"""
ASSIGN_FROM_THE_END = """for rows, across in [*self.window_slices(dy.shape)][::-1]:
    padded[:, rows, across] = share"""
ADD_TO_EQUAL = """source = self.padded(bottom[0].data[n], dy.shape, -np.inf)
for rows, across in self.window_slices(dy.shape):
    padded[:, rows, across] += dy[n] * (source[:, rows, across] == top[0].data[n])"""

SIZE_ROUNDED_DOWN = Mistake(
    "Caffe's pooling rounds the output size up, not down: the last window may extend past the edge.",
    ("-(-extent // stride) if rounds_up else extent // stride", "extent // stride"),
)
DX_ASSIGNED = Mistake(
    "dx is assigned where it must be added to: windows overlap, and a pixel receives the gradient of each. Use"
    " += in a loop; with an array of indices, += adds only once per index, and np.add.at adds all.",
    (ADD_MAX, "padded[c, h * sh + i, w * sw + j] += dy[n]"),
    ("padded[:, rows, across] += share", "padded[:, rows, across] = share"),
    (ADD_MEANS, ASSIGN_FROM_THE_END),
)
PADDED_WITH_ZEROS = Mistake(
    "The padding must never be the maximum, and 0 exceeds negative values: pad with -infinity.",
    ("-np.inf if self.is_max else 0", "0"),
)
GRADIENT_TO_ALL_TIES = Mistake(
    "Of equal maxima only the first receives the gradient; here all do. Store in forward which one was "
    "selected.",
    (ADD_MAX, ADD_TO_EQUAL),
)
WHOLE_KERNEL_AREA = Mistake(
    "The mean divides by the whole kernel area. The part of a window outside the padded image is not counted; "
    "area() returns the number of counted elements.",
    (
        "windows.sum(axis=0) / self.area(x.shape, y.shape)",
        "windows.sum(axis=0) / np.prod(self.kernel)",
    ),
)
MISTAKES = (
    SIZE_ROUNDED_DOWN,
    DX_ASSIGNED,
    PADDED_WITH_ZEROS,
    GRADIENT_TO_ALL_TIES,
    WHOLE_KERNEL_AREA,
)


def _different(*shape: int, seed: int = 0) -> Array:
    """Return well-separated values, most of them negative."""
    count = int(np.prod(shape))
    return np.asarray(
        np.random.default_rng(seed).permutation(count).reshape(shape) / 7.0 - count / 9
    )


TIES = np.random.default_rng(5).integers(0, 3, (1, 1, 5, 6)).astype(float)
OVERLAP = "an overlap of windows"
ROUNDED = "a size that is rounded up"
RECTANGLE = "unequal kernel and stride"
EQUAL = "a tie"
MASK = "a second top"
PAD = "padding"
FLOOR = "round_mode: FLOOR"
GLOBAL = "global_pooling: true"
AVE = "pool: AVE"
AVE_OVERLAP = "AVE and an overlap of windows"
AVE_ROUNDED = "AVE and a size that is rounded up"
AVE_PAD = "AVE and padding"
MEANS = "pool: AVE kernel_h: 2 kernel_w: 3 stride_h: 2 stride_w: 3"

TO_DO = {
    "_outputs": "Return the size of the output in direction i (0 down, 1 across) for an input of this size: round "
    "up unless self.param.round_mode is FLOOR; with padding in either direction, any(self.pad), drop a last window "
    "that starts beyond the image. The kernel is self.whole_kernel[i]. (The project's layer also raises "
    "an error if no window is left.)",
    "forward": "Write top[0].data, and the mask into top[1].data if there is one. self.is_max is true for MAX. "
    "Store what backward needs, as self.winners. padded(x[n], y.shape, value), windows(), _index() and area() "
    "help. Begin with MAX without options, the check adds one after the other, then AVE.",
    "backward": "If propagate_down[0], write every element of bottom[0].diff: sum the contributions of windows "
    "that share a pixel; pixels of no window are 0.",
}
LETTERS = Letters(("x",), ("y", "mask"), axes={"x": "nchw", "y": "nchw", "mask": "nchw"})
EXAMPLES = [
    Example("kernel_size: 2 stride: 2", (_different(2, 2, 4, 6),)),
    Example("kernel_size: 4 stride: 4", caffe="pool_MAX_k4s4_even"),
    Example("kernel_size: 3", (_different(1, 1, 5, 6, seed=2),), OVERLAP),
    Example("kernel_size: 2 stride: 2", (_different(2, 2, 5, 4),), ROUNDED),
    Example("kernel_size: 2 stride: 2", option=ROUNDED, caffe="pool_MAX_k2s2_odd"),
    Example(
        "kernel_h: 2 kernel_w: 3 stride_h: 2 stride_w: 1",
        (_different(1, 2, 5, 6, seed=8),),
        RECTANGLE,
    ),
    Example("kernel_size: 3 stride: 2", option=EQUAL, caffe="pool_MAX_ties"),
    Example("kernel_size: 3 stride_h: 2 stride_w: 1", (TIES,), MASK, tops=2, gradient=False),
    Example(
        "kernel_size: 3 stride_h: 2 stride_w: 1 pad_h: 1 pad_w: 2",
        (_different(1, 2, 5, 6, seed=1),),
        PAD,
    ),
    Example(
        "kernel_size: 2 stride_h: 2 stride_w: 1 pad_h: 1 pad_w: 0",
        (_different(1, 1, 5, 6, seed=7),),
        PAD,
    ),
    Example("kernel_size: 3 stride: 2 pad: 1", option=PAD, caffe="pool_MAX_k3s2p1_odd"),
    Example(
        "kernel_size: 2 stride_h: 2 stride_w: 3 round_mode: FLOOR",
        (_different(1, 1, 5, 7, seed=3),),
        FLOOR,
    ),
    Example("global_pooling: true", (_different(1, 2, 3, 4, seed=4),), GLOBAL),
    Example(MEANS, (_different(2, 1, 4, 6, seed=5),), AVE),
    Example("pool: AVE kernel_h: 2 kernel_w: 3", (_different(1, 1, 5, 6, seed=9),), AVE_OVERLAP),
    Example(MEANS, (_different(2, 1, 5, 7, seed=5),), AVE_ROUNDED),
    Example("pool: AVE kernel_size: 2 stride: 2", option=AVE_ROUNDED, caffe="pool_AVE_k2s2_odd"),
    Example(
        "pool: AVE kernel_size: 3 stride_h: 2 stride_w: 1 pad_h: 1 pad_w: 2",
        (_different(1, 2, 5, 6, seed=6),),
        AVE_PAD,
    ),
    Example(
        "pool: AVE kernel_size: 3 stride: 2 pad: 1", option=AVE_PAD, caffe="pool_AVE_k3s2p1_odd"
    ),
]
HINTS = {
    OVERLAP: "A pixel can be the maximum of several windows, and its gradient is the sum of theirs.",
    ROUNDED: "The size is rounded up, and the last window covers only the pixels inside the image.",
    RECTANGLE: "self.kernel is (kh, kw), and self.stride and self.pad have the same order: down, across.",
    EQUAL: "Of equal maxima the first in row-major order is selected: in a loop over the window use >, not >=. It "
    "alone receives the gradient.",
    MASK: "top[1] is the mask: the index h W + w of the maximum in the map of the input, not in the window.",
    PAD: "The window of row h begins at row h stride - pad. Padding is never the maximum. A last window that "
    "starts at or after row size + pad, counted from the edge of the padding, is dropped. dx has no padding.",
    FLOOR: "With round_mode FLOOR the size is rounded down.",
    GLOBAL: "One window covers the whole map: self.kernel has its size.",
    AVE: "If not self.is_max, y is the mean of the window, and each of its pixels receives dy / area.",
    AVE_OVERLAP: "A pixel receives a share of the gradient of each window: add them, with +=.",
    AVE_ROUNDED: "The area counts no part of a window outside the padded image: area() returns it.",
    AVE_PAD: "Caffe's area counts the padding (PyTorch's count_include_pad), but nothing beyond it: area() returns "
    "it.",
}

EXERCISE = layer_exercise(
    "pooling",
    "Pooling",
    title="Pooling: the maximum or the mean of a window",
    chapter=4,
    file="layers/vision/pooling.py",
    block="pooling_param",
    to_do=TO_DO,
    shaped_by="_outputs",
    letters=LETTERS,
    examples=EXAMPLES,
    hints=HINTS,
    mistakes=MISTAKES,
)
