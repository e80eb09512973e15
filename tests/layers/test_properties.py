"""What layer types state of their computation, which the fast engine relies on, is true."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from netlib import gradcheck
from netlib.blob import Array, Blob, Blobs
from netlib.layer import Layer
from netlib.proto.schema import Phase
from tests.support.layer_cases import CASES, different, off_zero

Bottoms = Callable[[int], list[Array]]


@dataclass(frozen=True)
class Example:
    """A layer with its options; ``bottoms`` makes the bottoms for a number of items."""

    text: str
    bottoms: Bottoms
    tops: int = 1
    wanted: Sequence[bool] | None = None
    phase: Phase = "TRAIN"

    def layer(self, arrays: list[Array]) -> Layer:
        """Return a new layer; all of them have the same parameters."""
        return gradcheck.make_layer(self.text, arrays, self.tops, self.phase)


def one(*shape: int) -> Bottoms:
    """One bottom, of items of this shape."""
    return lambda N: [off_zero(N, *shape)]


def two(*shape: int) -> Bottoms:
    """Two bottoms, of items of this shape."""
    return lambda N: [off_zero(N, *shape), off_zero(N, *shape)]


EXAMPLES = {}  # of every type
for name, (options, bottoms, more) in CASES.items():
    EXAMPLES[name] = Example(f'type: "{name}" {options}', bottoms, **more)
BATCHWISE = {
    "BN with moving averages": Example(
        'type: "BN" bn_param { slope_filler { value: 2 } frozen: true }', one(3, 2, 4)
    ),
    "BatchNorm with sums": Example('type: "BatchNorm"', one(3, 2, 4), phase="TEST"),
    "Bias of one number": Example('type: "Bias" bias_param { num_axes: 0 }', one(2, 3)),
    "Dropout in TEST": Example('type: "Dropout"', one(5), phase="TEST"),
    "leaky ReLU": Example('type: "ReLU" relu_param { negative_slope: 0.1 }', one(3)),
    "linear Power": Example('type: "Power" power_param { scale: 3 }', one(3)),
    "mask of Pooling": Example(
        'type: "Pooling" pooling_param { kernel_size: 2 }',
        lambda N: [different(N, 2, 3, 4)],
        tops=2,
    ),
    "mean by Pooling": Example('type: "Pooling" pooling_param { pool: AVE kernel_size: 2 }', one(2, 3, 4)),
    "product": Example('type: "Eltwise" eltwise_param { operation: PROD }', two(3)),
    "product with a quotient as gradient": Example(
        'type: "Eltwise" eltwise_param { operation: PROD stable_prod_grad: false }', two(3)
    ),
    "sum": Example('type: "Eltwise"', two(3)),
    "Scale of one number": Example('type: "Scale" scale_param { num_axes: 0 }', one(2, 3)),
    "Upsample without a mask": Example('type: "Upsample" upsample_param { scale: 3 }', one(2, 2, 3)),
}  # fmt: skip
OF_THE_BATCH = {
    "Bias per item": Example('type: "Bias" bias_param { axis: 0 }', one(3)),
    "Concat of items": Example('type: "Concat" concat_param { axis: 0 }', two(3)),
    "Convolution of one item": Example(
        'type: "Convolution" convolution_param { axis: 0 num_output: 2 kernel_size: 2 }', one(3, 4)
    ),
    "InnerProduct of all items": Example(
        'type: "InnerProduct" inner_product_param { axis: 0 num_output: 2 }', one(3)
    ),
    "Interp to the size of a bottom": Example('type: "Interp"', two(2, 3, 3), wanted=[True, False]),
    "Permute of the items": Example('type: "Permute" permute_param { order: 1 }', one(3)),
    "Scale by a bottom": Example('type: "Scale"', lambda N: [off_zero(N, 3), off_zero(3)]),
    "Softmax over the items": Example('type: "Softmax" softmax_param { axis: 0 }', one(3)),
}
ALL = EXAMPLES | BATCHWISE | OF_THE_BATCH


def run(
    layer: Layer, example: Example, arrays: list[Array], together: bool = False
) -> tuple[Blobs, Blobs]:
    """Run the layer forward, in place if ``together``, and return its bottoms and tops.

    The next run draws the same random numbers.
    """
    bottom = Blobs([Blob(np.shape(x), np.float64) for x in arrays])
    top = bottom if together else Blobs([Blob((), np.float64) for _ in range(example.tops)])
    for blob, x in zip(bottom, arrays):
        blob.data[...] = x
    start = layer.state()
    layer.reshape(bottom, top)
    layer.forward(bottom, top)
    layer.restore(start)
    return bottom, top


def states(name: str, statement: str) -> bool:
    """Whether a layer makes a statement after reshape."""
    arrays = ALL[name].bottoms(2)
    layer = ALL[name].layer(arrays)
    run(layer, ALL[name], arrays)
    return bool(getattr(layer, statement))


@pytest.mark.parametrize("name", [name for name in ALL if states(name, "batchwise")])
def test_a_batchwise_layer_treats_every_item_alone(name: str) -> None:
    """Item n of a top depends only on item n of the bottoms, as slices require."""
    example = ALL[name]
    arrays = example.bottoms(5)
    layer = example.layer(arrays)
    whole = [blob.data for blob in run(layer, example, arrays)[1]]
    for i in range(5):
        alone = [blob.data for blob in run(layer, example, [x[i : i + 1] for x in arrays])[1]]
        assert all(np.allclose(a[0], w[i], rtol=1e-13, atol=1e-13) for a, w in zip(alone, whole))


def test_the_options_decide_which_layers_are_batchwise() -> None:
    assert [name for name in BATCHWISE if not states(name, "batchwise")] == []
    assert [name for name in OF_THE_BATCH if states(name, "batchwise")] == []


@pytest.mark.parametrize("name", [name for name in ALL if states(name, "elementwise")])
def test_an_elementwise_layer_treats_every_value_alone(name: str) -> None:
    """If a bottom value changes, only the top values in its place do; that of 0 is finite."""
    example = ALL[name]
    [x] = example.bottoms(2)
    layer = example.layer([x])
    assert layer.batchwise
    before = [blob.data for blob in run(layer, example, [x])[1]]
    for place in np.ndindex(x.shape):
        changed = x.copy()
        changed[place] = 0
        for y, old in zip(run(layer, example, [changed])[1], before):
            assert np.isfinite(y.data[place])
            y.data[place] = old[place]
            assert_array_equal(y.data, old)


def unread(layer: Layer, bottom: Blobs, top: Blobs) -> list[Blob]:
    """The blobs whose data backward does not read."""
    read = [*(bottom if layer.reads_bottom else []), *([] if layer.reads_top is False else top)]
    return [blob for blob in [*bottom, *top] if blob not in read]


def in_place(name: str) -> bool:
    """Whether the layer of an example can run in place."""
    arrays = ALL[name].bottoms(2)
    return ALL[name].layer(arrays).in_place and len(arrays) == ALL[name].tops == 1


@pytest.mark.parametrize(
    ("name", "together"),
    [(name, False) for name in ALL] + [(name, True) for name in ALL if in_place(name)],
)
def test_backward_reads_only_what_it_says(name: str, together: bool) -> None:
    """Data that backward does not read may be overwritten; if it does not read what forward kept,
    a new layer may run it.
    """
    example = ALL[name]
    arrays = example.bottoms(2)
    wanted = list(example.wanted or [True] * len(arrays))
    found = []
    for spoil in (False, True):
        layer = example.layer(arrays)
        bottom, top = run(layer, example, arrays, together)
        for blob in top:
            blob.diff[...] = np.arange(blob.count).reshape(blob.shape) + 1
        for blob in unread(layer, bottom, top) if spoil else []:
            blob.data[...] = np.nan
        if spoil and not layer.reads_kept:
            layer = example.layer(arrays)
            layer.reshape(bottom, top)
        layer.backward(top, wanted, bottom)
        diffs = [blob.diff for blob, want in zip(bottom, wanted) if want]
        found.append(diffs + [param.diff for param in layer.blobs])
    for a, b in zip(*found):
        assert_array_equal(a, b)
