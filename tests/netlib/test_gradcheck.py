"""The gradient check accepts correct layers and detects wrong ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from layers import LAYER_TYPES
from netlib import gradcheck
from netlib.blob import Blobs
from netlib.fillers import Filler
from netlib.gradcheck import GradientError
from netlib.layer import Layer
from tests.netlib.conftest import MakeModule

pytestmark = pytest.mark.both_engines

X = np.random.default_rng(0).uniform(0.5, 1, (3, 2))


class Right(Layer):
    """y = gain x² + noise, with noise from the layer's random stream."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.new_param("gain", (2,), Filler("uniform", min=1, max=2))

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = self.blobs[0].data * bottom[0].data ** 2 + self.rng.normal(
            size=bottom[0].shape
        )

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        self.blobs[0].diff[...] += (top[0].diff * bottom[0].data ** 2).sum(axis=0)
        if propagate_down[0]:
            slope = 2 * self.blobs[0].data * bottom[0].data
            bottom[0].diff[...] = slope * top[0].diff


class Spoilt(Right):
    """A backward that is wrong because of what is done before it or after it."""

    def before(self, top: Blobs, bottom: Blobs) -> None:
        pass

    def after(self, top: Blobs, bottom: Blobs) -> None:
        pass

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        self.before(top, bottom)
        super().backward(top, propagate_down, bottom)
        self.after(top, bottom)


def spoilt(name: str, **methods: Callable[..., object]) -> type[Layer]:
    return type(name, (Spoilt,), methods)


def scale(array: np.ndarray, place: object, factor: float) -> None:
    array[place] *= factor


Forgets = spoilt("Forgets", after=lambda self, top, bottom: scale(bottom[0].diff, (1, 1), np.nan))
Overwrites = spoilt(
    "Overwrites", before=lambda self, top, bottom: scale(self.blobs[0].diff, ..., 0)
)
Wrong = spoilt("Wrong", after=lambda self, top, bottom: scale(bottom[0].diff, (2, 0), 1.0001))
IgnoresTop = spoilt("IgnoresTop", before=lambda self, top, bottom: top[0].diff.fill(1))


@pytest.fixture
def layer(monkeypatch: pytest.MonkeyPatch) -> Callable[[type[Layer]], Layer]:
    """A factory of layers whose class is registered for this test."""

    def make(cls: type[Layer]) -> Layer:
        monkeypatch.setitem(LAYER_TYPES, cls.__name__, cls)
        return gradcheck.make_layer(f'type: "{cls.__name__}"', [X])

    return make


def test_a_right_layer_passes_and_is_as_before(layer: Callable[[type[Layer]], Layer]) -> None:
    """A layer with random noise passes, because its stream is rewound before each forward pass."""
    made, x = layer(Right), X.copy()
    gain = made.blobs[0].data.copy()
    gradcheck.check(made, [x])
    assert np.array_equal(x, X)
    assert np.array_equal(made.blobs[0].data, gain)


class Rounds(Right):
    """Computes in float32."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = (self.blobs[0].data * bottom[0].data ** 2).astype(np.float32)


@pytest.mark.parametrize(
    ("cls", "message"),
    [
        (Forgets, r"Forgets: gradient of bottom 0 at \(1, 1\): backward computed nan"),
        (Overwrites, r"Overwrites: gradient of parameter 0 at \(\d,\)"),
        (
            Wrong,
            r"Wrong: gradient of bottom 0 at \(2, 0\): backward computed [-\d.]+, central differences give [-\d.e]+$",
        ),
        (IgnoresTop, "IgnoresTop: gradient of"),
        (
            Rounds,
            r"differences give [-\d.e]+; the tops are rounded to float32, which is too coarse for the differences: "
            "compute in the dtype of the bottoms, float64 here$",
        ),
    ],
)
def test_a_wrong_layer_is_caught(
    layer: Callable[[type[Layer]], Layer], cls: Any, message: str
) -> None:
    with pytest.raises(GradientError, match=message):
        gradcheck.check(layer(cls), [X])


@pytest.mark.parametrize("value", [0.0, 3e-7, -4e-7])
@pytest.mark.parametrize("text", ['type: "ReLU"', 'type: "HingeLoss"'])
def test_a_kink(value: float, text: str) -> None:
    """A kink at the value itself, and one at a distance smaller than the step, are reported."""
    x = [np.array([[value, 0.5], [0.25, 2.0]])]
    if "Hinge" in text:
        x = [np.array([[0.5, 1 + value], [0.25, 2.0]]), np.array([0.0, 1.0])]
        x[0][0, 1] = value - 1
    with pytest.raises(
        GradientError,
        match=r"; the difference to the left is .*, so there is a kink within 1e-06 of",
    ):
        gradcheck.check(gradcheck.make_layer(text, x), x, wanted=[True, False][: len(x)])


def test_the_error_names_the_layer_and_its_class(module: MakeModule) -> None:
    """A layer of a user has the type Python, so its name and class are given."""
    module(
        "own_wrong",
        "import netlib\n\n\nclass Wrong(netlib.Layer):\n"
        "    def reshape(self, bottom, top):\n        top[0].reshape(*bottom[0].shape)\n\n"
        "    def forward(self, bottom, top):\n        top[0].data[...] = bottom[0].data\n\n"
        "    def backward(self, top, propagate_down, bottom):\n        bottom[0].diff[...] = 2 * top[0].diff\n",
    )
    text = 'type: "Python" python_param { module: "own_wrong" layer: "Wrong" }'
    for name, begin in (
        ('name: "mine" ', r"layer 'mine' \(Wrong\): gradient of bottom 0"),
        ("", "Wrong: gradient of"),
    ):
        with pytest.raises(GradientError, match=f"^{begin}"):
            gradcheck.check(gradcheck.make_layer(name + text, [X]), [X])


def test_bottoms_that_want_no_gradient_are_left_out(layer: Callable[[type[Layer]], Layer]) -> None:
    """A bottom without a gradient, such as labels, gets propagate_down false and
    is not compared.
    """
    relu = gradcheck.make_layer('type: "ReLU"', [X])
    assert "nothing was checked" in repr(gradcheck.check(relu, [X], wanted=[False]))
    gradcheck.check(layer(Right), [X], wanted=[False])


def test_the_result_lists_what_was_checked() -> None:
    text = 'type: "InnerProduct" inner_product_param { num_output: 2 weight_filler { type: "xavier" } }'
    found = gradcheck.check(gradcheck.make_layer(text, [X]), [X])
    assert repr(found) == (
        f"backward agrees with central differences to 1e-06: bottom 0 {X.shape}, parameter 0 (2, {X[0].size}), "
        "parameter 1 (2,)"
    )
    assert 0 < max(found.differences.values()) < 1e-6
