"""Exercise: the layer Pooling, with Caffe's rules for windows that extend past the edge."""

from __future__ import annotations

import numpy as np

from exercises.exercise import Mistake
from exercises.layers import Example, Letters, Option, layer_exercise
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
    """Return values of which no two are closer than 1/7, most of them negative."""
    count = int(np.prod(shape))
    return np.random.default_rng(seed).permutation(count).reshape(shape) / 7.0 - count / 9


TIES = np.random.default_rng(5).integers(0, 3, (2, 2, 5, 6))
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
LETTERS = Letters({"x": "n c h w"}, {"y": "n c h w", "mask": "n c h w"})
EXAMPLES = (
    Example("kernel_size: 2 stride: 2", (_different(2, 2, 4, 6),)),
    Example("kernel_size: 4 stride: 4", caffe="pool_MAX_k4s4_even"),
)
OVERLAP = Option(
    "an overlap of windows",
    "A pixel can be the maximum of several windows, and its gradient is the sum of theirs.",
    Example("kernel_size: 3", (_different(1, 1, 5, 6, seed=2),)),
)
ROUNDED = Option(
    "a size that is rounded up",
    "The size is rounded up, and the last window covers only the pixels inside the image.",
    Example("kernel_size: 2 stride: 2", (_different(2, 2, 5, 4),)),
    Example("kernel_size: 2 stride: 2", caffe="pool_MAX_k2s2_odd"),
)
RECTANGLE = Option(
    "unequal kernel and stride",
    "self.kernel is (kh, kw), and self.stride and self.pad have the same order: down, across.",
    Example("kernel_h: 2 kernel_w: 3 stride_h: 2 stride_w: 1", (_different(1, 2, 5, 6, seed=8),)),
)
EQUAL = Option(
    "a tie",
    "Of equal maxima the first in row-major order is selected: in a loop over the window use >, not >=. It "
    "alone receives the gradient.",
    Example("kernel_size: 3 stride: 2", caffe="pool_MAX_ties"),
)
MASK = Option(
    "a second top",
    "top[1] is the mask: the index h W + w of the maximum in the map of the input, not in the window.",
    Example("kernel_size: 3 stride_h: 2 stride_w: 1", (TIES,), tops=2, on_kinks=True),
)
PAD = Option(
    "padding",
    "The window of row h begins at row h stride - pad. Padding is never the maximum. A last window that "
    "starts at or after row size + pad, counted from the edge of the padding, is dropped, "
    "in both directions even if only one has padding. dx has none.",
    Example(
        "kernel_size: 3 stride_h: 2 stride_w: 1 pad_h: 1 pad_w: 2",
        (_different(1, 2, 5, 6, seed=1),),
        tops=2,
    ),
    Example(
        "kernel_size: 2 stride_h: 2 stride_w: 3 pad_h: 1 pad_w: 0",
        (_different(1, 1, 5, 6, seed=7),),
    ),
    Example("kernel_size: 3 stride: 2 pad: 1", caffe="pool_MAX_k3s2p1_odd"),
)
FLOOR = Option(
    "round_mode: FLOOR",
    "With round_mode FLOOR the size is rounded down.",
    Example(
        "kernel_size: 2 stride_h: 2 stride_w: 3 round_mode: FLOOR",
        (_different(1, 1, 5, 7, seed=3),),
    ),
)
GLOBAL = Option(
    "global_pooling: true",
    "One window covers the whole map: self.kernel has its size.",
    Example("global_pooling: true", (_different(1, 2, 3, 4, seed=4),)),
)
AVE = Option(
    "pool: AVE",
    "If not self.is_max, y is the mean of the window, and each of its pixels receives dy / area.",
    Example(MEANS, (_different(2, 1, 4, 6, seed=5),)),
)
AVE_OVERLAP = Option(
    "AVE and an overlap of windows",
    "A pixel receives a share of the gradient of each window: add them, with +=.",
    Example("pool: AVE kernel_h: 2 kernel_w: 3", (_different(1, 1, 5, 6, seed=9),)),
)
AVE_ROUNDED = Option(
    "AVE and a size that is rounded up",
    "The area counts no part of a window outside the padded image: area() returns it.",
    Example(MEANS, (_different(2, 1, 5, 7, seed=5),)),
    Example("pool: AVE kernel_size: 2 stride: 2", caffe="pool_AVE_k2s2_odd"),
)
AVE_PAD = Option(
    "AVE and padding",
    "Caffe's area counts the padding (PyTorch's count_include_pad), but nothing beyond it: area() returns "
    "it.",
    Example(
        "pool: AVE kernel_size: 3 stride_h: 2 stride_w: 1 pad_h: 1 pad_w: 2",
        (_different(1, 2, 5, 6, seed=6),),
    ),
    Example("pool: AVE kernel_size: 3 stride: 2 pad: 1", caffe="pool_AVE_k3s2p1_odd"),
)

OPTIONS = (
    OVERLAP,
    ROUNDED,
    RECTANGLE,
    EQUAL,
    MASK,
    PAD,
    FLOOR,
    GLOBAL,
    AVE,
    AVE_OVERLAP,
    AVE_ROUNDED,
    AVE_PAD,
)

EXERCISE = layer_exercise(
    "Pooling",
    title="Pooling: the maximum or the mean of a window",
    chapter=4,
    block="pooling_param",
    to_do=TO_DO,
    shaped_by="_outputs",
    letters=LETTERS,
    examples=EXAMPLES,
    options=OPTIONS,
    mistakes=MISTAKES,
)
