"""Exercise: the layer InnerProduct, which has parameters."""

from __future__ import annotations

import numpy as np

from exercises.exercise import known_in
from exercises.layer_examples import Example, Letters, numbers
from exercises.layers import layer_exercise
from layers.common.inner_product import InnerProduct
from netlib.blob import Array, Blobs


class KeepsAxes(InnerProduct):
    """Only the last axis is replaced. All axes from self.axis on are the inputs of one item; one axis of size
    num_output replaces all of them.
    """

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(*bottom[0].shape[:-1], self.param.num_output)


class FlattensAll(InnerProduct):
    """The option axis is ignored: every axis before self.axis is a batch axis, not only the first."""

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape[0], self.param.num_output)


class TakesColumns(InnerProduct):
    """w has one row per output, (O, I), so y = x wᵀ, not x w."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y, w = self.rows(bottom[0].data), self.rows(top[0].data), self.output_first(self.blobs[0].data)
        y[...] = x @ w
        if self.param.bias_term:
            y += self.blobs[1].data


class IgnoresTranspose(InnerProduct):
    """With transpose: true the parameter is stored as (I, O). self.output_first() transposes it."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y = self.rows(bottom[0].data), self.rows(top[0].data)
        y[...] = x @ self.blobs[0].data.T
        if self.param.bias_term:
            y += self.blobs[1].data


class NoBias(InnerProduct):
    """The bias is missing: y = x wᵀ + b, if self.param.bias_term."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y, w = self.rows(bottom[0].data), self.rows(top[0].data), self.output_first(self.blobs[0].data)
        y[...] = x @ w.T


class BiasPerItem(InnerProduct):
    """b is added along the items. It has one value per output, the last axis of y, so y += b is enough."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y, w = self.rows(bottom[0].data), self.rows(top[0].data), self.output_first(self.blobs[0].data)
        y[...] = x @ w.T
        if self.param.bias_term:
            y += self.blobs[1].data[:, None]


class TransposedInBackward(InnerProduct):
    """dx = dy w, without a transpose: y = x wᵀ already has one, and transposing it again gives w."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, [False], bottom)
        if propagate_down[0]:
            self.rows(bottom[0].diff)[...] = self.rows(top[0].diff) @ self.output_first(self.blobs[0].data).T


class IgnoresTransposeBackward(InnerProduct):
    """backward always takes the parameter as (O, I). With transpose: true it is stored as (I, O), and so is its diff:
    self.output_first() transposes both.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        kept = self.blobs[0].diff.copy()
        super().backward(top, [False], bottom)
        dy = self.rows(top[0].diff)
        self.blobs[0].diff[...] = kept + dy.T @ self.rows(bottom[0].data)
        if propagate_down[0]:
            self.rows(bottom[0].diff)[...] = dy @ self.blobs[0].data


class WeightGradientTransposed(InnerProduct):
    """dw has the shape of w, (O, I): dyᵀ x, not xᵀ dy."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        kept = self.blobs[0].diff.copy()
        super().backward(top, propagate_down, bottom)
        self.blobs[0].diff[...] = kept + self.rows(bottom[0].data).T @ self.rows(top[0].diff)


class Means(InnerProduct):
    """A parameter gradient is divided by the number of items. dw and db are sums over the items: a loss that is a mean
    divides in its own backward.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        before = [blob.diff.copy() for blob in self.blobs]
        super().backward(top, propagate_down, bottom)
        items = len(self.rows(top[0].diff))
        for blob, kept in zip(self.blobs, before):
            blob.diff[...] = kept + (blob.diff - kept) / items


class BiasOverOutputs(InnerProduct):
    """db is summed over the outputs. b[o] is added to y[n, o] of every item n, so sum over the items: axis 0."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        kept: Array | None = self.blobs[1].diff.copy() if self.param.bias_term else None
        super().backward(top, propagate_down, bottom)
        if kept is not None:
            self.blobs[1].diff[...] = kept + self.rows(top[0].diff).sum(axis=1)


class ForgetsBiasGradient(InnerProduct):
    """db is not added: self.bias.diff is unchanged."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        kept = [blob.diff.copy() for blob in self.blobs[1:]]
        super().backward(top, propagate_down, bottom)
        for blob, diff in zip(self.blobs[1:], kept):
            blob.diff[...] = diff


class AssignsWeights(InnerProduct):
    """dw[...] = inside the loop over the items replaces the sum of the items before, and what earlier batches have
    added. Use dw[...] += there.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        dw = self.output_first(self.blobs[0].diff)
        dw[...] = np.outer(self.rows(top[0].diff)[-1], self.rows(bottom[0].data)[-1])


class AssignsBias(InnerProduct):
    """db[...] = inside the loop over the items replaces the sum of the items before, and what earlier batches have
    added. Use db[...] += there.
    """

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        super().backward(top, propagate_down, bottom)
        for blob in self.blobs[1:]:
            blob.diff[...] = self.rows(top[0].diff)[-1]


def _options(more: str = "", outputs: int = 3) -> str:
    return f"inner_product_param {{ num_output: {outputs}{' ' if more else ''}{more} }}"


EXERCISE = layer_exercise(
    "inner_product",
    "InnerProduct",
    title="InnerProduct: a weighted sum of all inputs",
    chapter=2,
    file="layers/common/inner_product.py",
    to_do={
        "reshape": "Give top[0] the axes before self.axis, followed by one of size self.param.num_output. (The "
        "project's layer also raises an error if the number of inputs is no longer self.inputs.)",
        "forward": "Write top[0].data: y = x wᵀ + b. w is self.weight.data, b is self.bias.data, if "
        "self.param.bias_term. rows() and output_first() give the matrices of the formula, as views.",
        "backward": "Add to self.weight.diff and self.bias.diff, with +=: dw = dyᵀ x, db = sum of dy over the "
        "items. If propagate_down[0], write bottom[0].diff: dx = dy w.",
    },
    letters=Letters(("x",), ("y",), ("w", "b"), {"x": "ni", "y": "no", "w": "oi", "b": "o"}),
    examples=[
        Example(_options(), (numbers(3, 3),)),
        Example(_options("transpose: true"), (numbers(3, 3, seed=1),)),
        Example(_options("bias_term: false", 2), (numbers(2, 3, seed=2),)),
        Example(_options("axis: 2"), (numbers(2, 2, 2, 2, seed=3),)),
        Example(_options(outputs=2), (numbers(3, 2, 1, 2, seed=4),)),
    ],
    from_caffe={
        "ip_4d": Example("inner_product_param { num_output: 7 }", ()),
        "ip_axis2": Example("inner_product_param { num_output: 7 axis: 2 }", ()),
    },
    mistakes=known_in(globals(), InnerProduct),
)
