"""Exercise: the layer Split, one blob with several readers."""

from __future__ import annotations

from exercises.exercise import Mistake
from exercises.layers import Example, Letters, layer_exercise, numbers

SUM = """for y in top[1:]:
    bottom[0].diff[...] += y.diff"""
MEAN = """for y in top[1:]:
    bottom[0].diff[...] += y.diff
bottom[0].diff[...] /= len(top)"""

DX_ASSIGNED = Mistake(
    "dx contains only the gradient of the last top: every iteration of the loop overwrites the previous one. L "
    "depends on x through all tops, so their gradients are summed.",
    ("bottom[0].diff[...] += y.diff", "bottom[0].diff[...] = y.diff"),
)
DX_AVERAGED = Mistake(
    "dx is the mean of the gradients. By the chain rule it is their sum.", (SUM, MEAN)
)
FIRST_COUNTED_TWICE = Mistake(
    "The gradient of the first top is counted twice: it is assigned first, then added with the others.",
    ("top[1:]", "top"),
)
DATA_DIVIDED = Mistake(
    "x is not divided among the readers: each gets all of it.",
    ("bottom[0].data", "bottom[0].data / len(top)"),
)
ONE_TOP_COPIED = Mistake(
    "Copy into every top, not only the first: for y in top.",
    ("y.data[...] = bottom[0].data", "top[0].data[...] = bottom[0].data"),
)
MISTAKES = (DX_ASSIGNED, DX_AVERAGED, FIRST_COUNTED_TWICE, DATA_DIVIDED, ONE_TOP_COPIED)

TO_DO = {
    "reshape": "Give every top the shape of bottom[0].",
    "forward": "Copy bottom[0].data into every top.",
    "backward": "If propagate_down[0], write bottom[0].diff: the sum of the diffs of all tops. It contains "
    "old values, so assign the first and add the others.",
}
LETTERS = Letters({"x": "n c"}, {"y_0": "n c", "y_1": "n c", "y_2": "n c"})
EXAMPLES = (
    Example(bottoms=(numbers(2, 3),), tops=2),
    Example(bottoms=(numbers(3, 2),), tops=3),
    Example(caffe="split_explicit", tops=3),
)

EXERCISE = layer_exercise(
    "Split",
    title="Split: one blob for several readers",
    chapter=5,
    to_do=TO_DO,
    letters=LETTERS,
    examples=EXAMPLES,
    mistakes=MISTAKES,
)
