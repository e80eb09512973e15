"""Layer types, options, and helpers for authors of layers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import netlib
from layers.activation.relu import ReLUParameter
from netlib import gradcheck
from netlib.blob import Blob
from netlib.proto.options import NoParameter

pytestmark = pytest.mark.both_engines


def test_layer_type_list() -> None:
    types = netlib.layer_type_list()
    assert types == sorted(types)
    assert {"Convolution", "HandModel", "DeepHandModel", "Python"} <= set(types)


def test_helpers_for_layer_authors() -> None:
    """canonical_axis resolves negative axes; fail adds the position of an option."""
    layer = gradcheck.make_layer('name: "p" type: "Power" power_param { scale: 2 }', [np.zeros(3)])
    assert [layer.canonical_axis(a, Blob((2, 3, 4))) for a in (0, 2, -1, -3)] == [0, 2, 2, 0]
    with pytest.raises(
        netlib.LayerError,
        match=r"layer 'p': axis 3 is out of range for a blob of 3 axes \(2, 3, 4\)",
    ):
        layer.canonical_axis(3, Blob((2, 3, 4)))
    assert str(layer.fail("says", "scale")) == "<gradcheck>:1:39: error: layer 'p': says"


def test_state_and_restore_rewind_the_random_stream() -> None:
    """The state holds plain numbers and strings, so that JSON can store it."""
    from netlib.snapshots.snapshot import as_plain

    layer: Any = gradcheck.make_layer('type: "Dropout"', [np.zeros(3)])
    state = as_plain(layer.state())
    first = layer.rng.random(5)
    layer.restore(state)
    assert np.array_equal(layer.rng.random(5), first)


def test_a_class_declares_the_type_of_its_options() -> None:
    """``param: ReLUParameter`` says it to readers and type checkers; subclasses inherit it."""

    @dataclass(frozen=True)
    class Options:
        """The options of a layer."""

    class Base(netlib.Layer):
        pass

    class Declaring(Base):
        param: ReLUParameter

    class Later(Declaring):
        pass

    class Own(Base):
        param_type = Options

    types = [one.param_type for one in (Base, Declaring, Later, Own)]
    assert types == [NoParameter, ReLUParameter, ReLUParameter, Options]
