"""The traits of layer types, which the fast engine relies on, are true."""

from __future__ import annotations

import numpy as np
import pytest

from fast.engine import FAST_CLASSES, FastEngine
from fast.traits import TABLE, LayerTraits, traits_of
from layers import BY_BOTTOMS, LAYER_TYPES
from layers.activation.relu import ReLU
from netlib import gradcheck
from netlib.blob import Blob, Blobs
from netlib.layer import Layer
from netlib.proto.options import PACKAGE, class_at
from tests.support.layer_cases import CASES, forward, made


def test_every_entry_is_a_layer_type() -> None:
    """Every entry of the table is the class of a layer type; others would never be used."""
    assert {class_at(PACKAGE, place) for place in TABLE} <= {
        *LAYER_TYPES.values(),
        *BY_BOTTOMS.values(),
    }


def test_a_fast_class_is_its_plain_class_with_another_computation() -> None:
    for place, fast in FAST_CLASSES.items():
        plain = class_at(PACKAGE, place)
        assert (
            issubclass(class_at("fast", fast), plain)
            and FastEngine().implementation(plain).__name__ == f"Fast{plain.__name__}"
        )
    assert traits_of(gradcheck.make_layer('type: "ReLU"', [np.zeros(3)])).monotone


def test_a_users_subclass_of_a_known_type_is_not_taken_for_it() -> None:
    class Own(ReLU):
        """A subclass that may compute anything."""

    layer = gradcheck.make_layer('type: "ReLU"', [np.zeros(3)])
    assert traits_of(Own(layer.spec, "TRAIN", layer.rng, np.float64)) == LayerTraits()


def test_a_users_class_of_the_same_name_is_not_taken_for_ours() -> None:
    """A class of a user's own module ``layers`` keeps its computation and the default traits."""

    class ReLU(Layer):
        """A layer that computes something else."""

    ReLU.__module__, ReLU.__qualname__ = "layers.activation.relu", "ReLU"
    layer = gradcheck.make_layer('type: "ReLU"', [np.zeros(3)])
    assert FastEngine().implementation(ReLU) is ReLU
    assert traits_of(ReLU(layer.spec, "TRAIN", layer.rng, np.float64)) == LayerTraits()


@pytest.mark.parametrize("name", [name for name in CASES if traits_of(made(name)[0]).batchwise])
def test_a_batchwise_layer_treats_every_item_alone(name: str) -> None:
    """Item n of a top depends only on item n of the bottoms, as slices require."""
    layer, bottoms = made(name, 5)
    tops = CASES[name][2].get("tops", 1)
    whole = forward(layer, bottoms, tops, False)
    for i in range(5):
        alone = forward(layer, [x[i : i + 1] for x in bottoms], tops, False)
        assert all(np.allclose(a[0], w[i], rtol=1e-13, atol=1e-13) for a, w in zip(alone, whole))


@pytest.mark.parametrize("name", CASES)
def test_backward_reads_only_what_it_says(name: str) -> None:
    """If ``reads_bottom`` or ``reads_top`` is false, backward does not read these data, which may
    be overwritten.
    """
    layer, arrays = made(name)
    options = CASES[name][2]
    wanted = options.get("wanted", [True] * len(arrays))
    found = []
    for spoil in (False, True):
        bottom = Blobs([Blob(np.shape(x), np.float64) for x in arrays])
        top = Blobs([Blob((), np.float64) for _ in range(options.get("tops", 1))])
        for blob, x in zip(bottom, arrays):
            blob.data[...] = x
        start = layer.state()
        layer.reshape(bottom, top)
        layer.forward(bottom, top)
        layer.restore(start)
        for blob in top:
            blob.diff[...] = 1
        if spoil:
            for blob in ([] if traits_of(layer).reads_bottom else bottom) + (
                [] if traits_of(layer).reads_top else top
            ):
                blob.data[...] = np.nan
        layer.backward(top, wanted, bottom)
        found.append([blob.diff.copy() for blob, want in zip(bottom, wanted) if want])
    assert all(np.array_equal(a, b) for a, b in zip(*found))
