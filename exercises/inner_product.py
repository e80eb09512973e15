"""Exercise: the layer InnerProduct, which has parameters."""

from __future__ import annotations

from exercises.exercise import Mistake
from exercises.layers import Example, Letters, Option, layer_exercise, numbers

W_NOT_TRANSPOSED = Mistake(
    "w has a row for each output, (O, I). y[n, o] is the product of row n of x and row o of w: y = x wᵀ, not x"
    " w.",
    ("x @ w.T", "x @ w"),
)
W_TRANSPOSED_TWICE = Mistake(
    "dx = dy w, without a transpose: y = x wᵀ already has one, and transposing it again gives w.",
    ("dy @ w", "dy @ w.T"),
)
DW_TRANSPOSED = Mistake(
    "dw has the shape of w, (O, I): dyᵀ x, not xᵀ dy.", ("dy.T @ x", "x.T @ dy")
)
GRADIENTS_ASSIGNED = Mistake(
    "A gradient is assigned in a loop over the items, which replaces the sum of the items before and what "
    "earlier batches have added. Use dw[...] += and db[...] += there.",
    (
        "self.output_first(self.weight.diff)[...] += dy.T @ x",
        "self.output_first(self.weight.diff)[...] = np.outer(dy[-1], x[-1])",
    ),
    ("self.bias.diff[...] += dy.sum(axis=0, dtype=np.float64)", "self.bias.diff[...] = dy[-1]"),
)
DB_OVER_OUTPUTS = Mistake(
    "db is summed over the outputs. b[o] is added to y[n, o] of every item n, so sum over the items: axis 0.",
    ("dy.sum(axis=0, dtype=np.float64)", "dy.sum(axis=1, dtype=np.float64)"),
)
MISTAKES = (
    W_NOT_TRANSPOSED,
    W_TRANSPOSED_TWICE,
    DW_TRANSPOSED,
    GRADIENTS_ASSIGNED,
    DB_OVER_OUTPUTS,
)

TO_DO = {
    "reshape": "Give top[0] the axes before self.axis, followed by one of size self.param.num_output. (The "
    "project's layer also raises an error if the number of inputs is no longer self.inputs.)",
    "forward": "Write top[0].data: y = x wᵀ + b. w is self.weight.data, b is self.bias.data, if "
    "self.param.bias_term. rows() and output_first() give the matrices of the formula, as views.",
    "backward": "Add to self.weight.diff and self.bias.diff, with [...] += on the left: dw = dyᵀ x, db = sum of "
    "dy over the items. If propagate_down[0], write bottom[0].diff: dx = dy w.",
}
LETTERS = Letters({"x": "n i"}, {"y": "n o"}, {"w": "o i", "b": "o"})
EXAMPLES = (Example("num_output: 3", (numbers(3, 3),)), Example("num_output: 2", (numbers(3, 4),)))
SEVERAL_AXES = Option(
    "an item with several axes",
    "All axes from self.axis on are the inputs of one item, and one axis of size "
    "num_output replaces them. rows() flattens them, as a view.",
    Example("num_output: 2", (numbers(3, 2, 1, 2),)),
    Example("num_output: 7", caffe="ip_4d"),
)
NO_BIAS = Option(
    "bias_term: false",
    "There is no self.bias then: use it only if self.param.bias_term.",
    Example("num_output: 2 bias_term: false", (numbers(2, 3),)),
)
TRANSPOSE = Option(
    "transpose: true",
    "The parameter and its diff are stored as (I, O) then; output_first() returns both as "
    "(O, I), as views.",
    Example("num_output: 3 transpose: true", (numbers(3, 3, seed=1),)),
)
AXIS = Option(
    "axis: 2",
    "Every axis before self.axis counts items, not only the first.",
    Example("num_output: 3 axis: 2", (numbers(2, 2, 2, 2),)),
    Example("num_output: 7 axis: 2", caffe="ip_axis2"),
)

OPTIONS = (SEVERAL_AXES, NO_BIAS, TRANSPOSE, AXIS)

EXERCISE = layer_exercise(
    "InnerProduct",
    title="InnerProduct: a weighted sum of all inputs",
    chapter=2,
    block="inner_product_param",
    to_do=TO_DO,
    letters=LETTERS,
    examples=EXAMPLES,
    options=OPTIONS,
    mistakes=MISTAKES,
)
