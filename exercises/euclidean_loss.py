"""Exercise: the layer EuclideanLoss, where backpropagation starts."""

from __future__ import annotations

from exercises.exercise import Mistake
from exercises.layers import Example, Letters, Option, layer_exercise, numbers

LOSS = "(self.difference**2).sum() / (2 * self.items)"

HALF_MISSING = Mistake(
    "The half is missing: L = 1 / (2 N) sum of (a - b)². It is there so that the gradient has no 2.",
    (LOSS, "(self.difference**2).sum() / self.items"),
)
NOT_DIVIDED_BY_N = Mistake(
    "The sum is not divided by the number of items N, self.items.",
    (LOSS, "(self.difference**2).sum() / 2"),
)
MEAN_OVER_VALUES = Mistake(
    "This is a mean over all values, as in other frameworks. Caffe's loss is half the sum, divided by the "
    "number of items only: 1 / (2 N).",
    (LOSS, "(self.difference**2).mean()"),
    (LOSS, "(self.difference**2).mean() / 2"),
)
DL_IGNORED = Mistake(
    "backward ignores top[0].diff (dL). It is the loss weight of the prototxt, and by the chain rule every "
    "gradient contains this factor.",
    ("sign * top[0].diff / self.items", "sign / self.items"),
)
SIGN_OF_DB = Mistake(
    "db has the sign of da. b is subtracted in a - b, so db = -da.",
    ("zip(bottom, propagate_down, (1, -1))", "zip(bottom, propagate_down, (1, 1))"),
)
MISTAKES = (HALF_MISSING, NOT_DIVIDED_BY_N, MEAN_OVER_VALUES, DL_IGNORED, SIGN_OF_DB)

TO_DO = {
    "forward": "Write top[0].data, one number: L = 1 / (2 N) sum of (a - b)². N is self.items; a and b "
    "have the same number of values for each item (self.values), but perhaps not the same "
    "shape. Store what backward needs.",
    "backward": "For each bottom with propagate_down: da = dL (a - b) / N, db = -dL (a - b) / N, "
    "in the shape of that bottom. dL is top[0].diff.",
}
LETTERS = Letters({"a": "n i", "b": "n i"}, {"L": ""})
EXAMPLES = (Example(bottoms=(numbers(4, 3), numbers(4, 3, seed=1))), Example(caffe="euclid"))
OTHER_SHAPE = Option(
    "bottom[1] of another shape", "", Example(bottoms=(numbers(3, 2, 2), numbers(3, 4, seed=2)))
)
LOSS_WEIGHT = Option("loss_weight: 3", "", Example("loss_weight: 3", caffe="euclid_lw3"))

EXERCISE = layer_exercise(
    "EuclideanLoss",
    title="EuclideanLoss: half the mean squared distance",
    chapter=6,
    to_do=TO_DO,
    letters=LETTERS,
    examples=EXAMPLES,
    options=(OTHER_SHAPE, LOSS_WEIGHT),
    mistakes=MISTAKES,
)
