"""Exercise: the layer ReLU, the simplest one."""

from __future__ import annotations

from exercises.exercise import Mistake
from exercises.layers import Example, Letters, Option, layer_exercise, numbers

BACKWARD = "np.where(x > 0, dy, self.slope * dy)"

DY_IGNORED = Mistake(
    "backward ignores top[0].diff. By the chain rule, dx is dy where x > 0 and slope * dy elsewhere.",
    (BACKWARD, "np.where(x > 0, 1, self.slope)"),
)
SIGN_OF_DY = Mistake(
    "backward uses the sign of dy. It must use the sign of x: dx is dy where x > 0.",
    (BACKWARD, "np.where(dy > 0, dy, self.slope * dy)"),
)
POSITIVE_AT_ZERO = Mistake(
    "At x = 0 Caffe uses the slope of the negative side: dx is dy only where x > 0, so use > instead of >=.",
    (BACKWARD, "np.where(x >= 0, dy, self.slope * dy)"),
)
SLOPE_IGNORED = Mistake(
    "backward ignores the slope: where x <= 0 the gradient is slope * dy, not 0.",
    (BACKWARD, "dy * (x > 0)"),
)
INPUT_CHANGED = Mistake(
    "forward changes bottom[0].data. It belongs to the previous layer, which may need it in its backward; "
    "write only into top[0].data.",
    (
        "top[0].data[...] = np.where(x > 0, x, self.slope * x)",
        "x[x < 0] *= self.slope\ntop[0].data[...] = x",
    ),
)
MISTAKES = (DY_IGNORED, SIGN_OF_DY, POSITIVE_AT_ZERO, SLOPE_IGNORED, INPUT_CHANGED)

TO_DO = {
    "reshape": "Give top[0] the shape of bottom[0].",
    "forward": "Read bottom[0].data (x) and write top[0].data (y): x where x > 0, self.slope * x elsewhere. Write "
    "into the existing array, top[0].data[...] = ..., and do not change bottom[0].data.",
    "backward": "If propagate_down[0], write every element of bottom[0].diff (dx): top[0].diff (dy) where x > 0, "
    "self.slope * dy elsewhere.",
}
LETTERS = Letters({"x": "n c w"}, {"y": "n c w"})
EXAMPLES = (Example(bottoms=(numbers(2, 3, 4),)), Example(caffe="relu"))
SLOPE = Option(
    "negative_slope",
    "Where x <= 0, y is self.slope * x and dx is self.slope * dy, not 0.",
    Example("negative_slope: 2", (numbers(2, 3, 4, seed=1),)),
    Example("negative_slope: 0.1", caffe="relu_neg"),
)
IN_PLACE = Option(
    "a layer in place",
    "In place, top[0].data and bottom[0].data are the same array, so reading x after writing y reads y. "
    "Compute the result in one expression.",
    Example("negative_slope: 0.1", (numbers(2, 3, 4, seed=2),), in_place=True),
)

EXERCISE = layer_exercise(
    "ReLU",
    title="ReLU: set negative values to zero",
    chapter=1,
    block="relu_param",
    to_do=TO_DO,
    letters=LETTERS,
    examples=EXAMPLES,
    options=(SLOPE, IN_PLACE),
    mistakes=MISTAKES,
)
