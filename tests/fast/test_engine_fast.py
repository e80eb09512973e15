"""The classes that the fast engine uses, and those of users, which it leaves as they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from fast.engine import FAST_CLASSES, FastEngine
from fast.slices import SlicedStep
from layers import LAYER_TYPES
from layers.activation.relu import ReLU
from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.options import PACKAGE, class_at
from tests.support.nets import inputs


def test_a_fast_class_is_its_plain_class_with_another_computation() -> None:
    for place, fast in FAST_CLASSES.items():
        plain = class_at(PACKAGE, place)
        assert (
            issubclass(class_at("fast", fast), plain)
            and FastEngine().implementation(plain).__name__ == f"Fast{plain.__name__}"
        )


def test_a_users_class_of_the_same_name_is_not_taken_for_ours() -> None:
    """A class of a user's own module ``layers`` keeps its computation."""

    class ReLU(Layer):
        """A layer that computes something else."""

    ReLU.__module__, ReLU.__qualname__ = "layers.activation.relu", "ReLU"
    assert FastEngine().implementation(ReLU) is ReLU


class OfTheBatch(ReLU):
    """A subclass that computes something else: item n of y depends on the other items of x."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read no options."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        top[0].data[...] = x - x.mean(axis=0)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy = top[0].diff
        bottom[0].diff[...] = dy - dy.mean(axis=0)


CONVOLUTION = (
    'layer {{ name: "{0}" type: "Convolution" bottom: "{1}" top: "{0}" '
    'convolution_param {{ num_output: 3 kernel_size: 1 weight_filler {{ type: "xavier" }} }} }} '
)


@pytest.mark.parametrize(
    "kind",
    [
        f'type: "Python" python_param {{ module: "{__name__}" layer: "OfTheBatch" }}',
        'type: "OfTheBatch"',
    ],
    ids=["of a Python layer", "in the table of types"],
)
def test_a_users_subclass_runs_on_the_whole_batch(
    agree: Callable[..., netlib.Net],
    monkeypatch: pytest.MonkeyPatch,
    rng: np.random.Generator,
    kind: str,
) -> None:
    """A subclass of a batchwise layer is not taken for it: the layers around it run in slices."""
    monkeypatch.setitem(LAYER_TYPES, "OfTheBatch", OfTheBatch)
    text = CONVOLUTION.format("a", "x")
    text += f'layer {{ name: "k" bottom: "a" top: "k" {kind} }} ' + CONVOLUTION.format("b", "k")
    text = f"force_backward: true {inputs(x=(80, 2, 4, 4))} {text}"
    net = agree(text, {"x": rng.normal(size=(80, 2, 4, 4))}, tolerance=1e-12)
    sliced = [
        at.layer.name
        for step in net.steps
        if isinstance(step, SlicedStep)
        for at in step.connections
    ]
    assert sliced == ["a", "b"]
