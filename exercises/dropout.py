"""Exercise: the layer Dropout, which behaves differently in training and testing."""

from __future__ import annotations

from exercises.exercise import Mistake
from exercises.layers import Example, Letters, Option, layer_exercise, numbers

NEW_MASK = """self.forward(bottom, [type(top[0])(top[0].shape, self.dtype)])
bottom[0].diff[...] = top[0].diff * self.factor"""

NOT_SCALED = Mistake(
    "The values kept are not scaled. In phase TRAIN they are x / (1 - p), which preserves the mean, so TEST "
    "needs no scaling.",
    ("(drawn >= least) * self.kept_scale", "(drawn >= least).astype(self.dtype)"),
)
MASK_INVERTED = Mistake(
    "The mask is inverted: p, the dropout_ratio, is the fraction dropped, so a value is kept where drawn >= "
    "least.",
    ("drawn >= least", "drawn < least"),
)
DROPPED_GRADIENT_KEPT = Mistake(
    "backward propagates the gradient of dropped values. They do not affect the loss: dx = dy factor.",
    ("top[0].diff * self.factor", "top[0].diff"),
)
MASK_DRAWN_AGAIN = Mistake(
    "backward draws a new mask. It must use that of the last forward, stored in self.factor.",
    ("bottom[0].diff[...] = top[0].diff * self.factor", NEW_MASK),
)
DROPPED_IN_TEST = Mistake(
    "In phase TEST nothing is dropped: y = x. Draw a mask only if self.active.",
    ("self.active", "True"),
)
MISTAKES = (NOT_SCALED, MASK_INVERTED, DROPPED_GRADIENT_KEPT, MASK_DRAWN_AGAIN, DROPPED_IN_TEST)

TO_DO = {
    "reshape": "Give top[0] the shape of bottom[0].",
    "forward": "Write top[0].data: y = x factor, and store self.factor for backward. If not self.active it is "
    "self.all_scale, else (drawn >= least) * self.kept_scale, with a new draw each time:\n"
    "drawn = self.rng.integers(0, 1 << 16, bottom[0].shape, dtype=np.uint16), least = round(p 65536), p = "
    "self.param.dropout_ratio. Draw exactly like this, so that the results can be compared.",
    "backward": "If propagate_down[0], write bottom[0].diff: dx = dy factor, with the factor of the last forward.",
}
LETTERS = Letters({"x": "n i"}, {"y": "n i"})
EXAMPLES = (
    Example("dropout_ratio: 0.3", (numbers(4, 5).round(),)),
    Example("dropout_ratio: 0", caffe="dropout_train_ratio0"),
)
IN_TEST = Option(
    "phase: TEST",
    "",
    Example("dropout_ratio: 0.3", (numbers(4, 5),), phase="TEST"),
    Example("dropout_ratio: 0.3", caffe="dropout_test", phase="TEST"),
)
SAMPLED_TEST = Option(
    "sample_weights_test: true",
    "",
    Example("dropout_ratio: 0.3 sample_weights_test: true", (numbers(4, 5),), phase="TEST"),
)
UNSCALED_TRAINING = Option(
    "scale_train: false", "", Example("dropout_ratio: 0.3 scale_train: false", (numbers(4, 5),))
)
SCALED_TEST = Option(
    "scale_train: false in phase TEST",
    "",
    Example("dropout_ratio: 0.3 scale_train: false", (numbers(4, 5),), phase="TEST"),
)
IN_PLACE = Option(
    "a layer in place", "", Example("dropout_ratio: 0.7", (numbers(4, 5),), in_place=True)
)
OPTIONS = (IN_TEST, SAMPLED_TEST, UNSCALED_TRAINING, SCALED_TEST, IN_PLACE)

EXERCISE = layer_exercise(
    "Dropout",
    title="Dropout: random values are set to zero",
    chapter=7,
    block="dropout_param",
    to_do=TO_DO,
    letters=LETTERS,
    examples=EXAMPLES,
    options=OPTIONS,
    mistakes=MISTAKES,
)
