"""What holds for every layer type: its gradient, another batch size, running in place, no hook that is misspelt."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

from layers import LAYER_TYPES
from netlib import gradcheck
from netlib.blob import Blob, Blobs
from netlib.layer import Layer

RNG = np.random.default_rng(0)


def off_zero(*shape: int) -> np.ndarray:
    """Random numbers away from 0."""
    return RNG.choice([-1.0, 1.0], shape) * RNG.uniform(0.2, 1, shape)


def different(*shape: int) -> np.ndarray:
    """Numbers far apart from each other."""
    return RNG.permutation(int(np.prod(shape))).reshape(shape) / 7.0


# type -> options, makers of the bottoms for N items, number of tops; ``wanted``: bottoms that get a gradient
CASES: dict[str, tuple[str, Any, dict[str, Any]]] = {
    "Accuracy": ("", lambda N: [off_zero(N, 3), RNG.integers(0, 3, N)], {"wanted": [False, False]}),
    "Concat": ("", lambda N: [off_zero(N, 2), off_zero(N, 3)], {}),
    "Convolution": (
        'convolution_param { num_output: 2 kernel_size: 2 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(N, 2, 3, 4)],
        {},
    ),
    "DeepHandModel": ("", lambda N: [off_zero(N, 47)], {}),
    "DeepHandModelDofConstraintLoss": ("", lambda N: [3 * off_zero(N, 47)], {}),
    "Dropout": ("", lambda N: [off_zero(N, 5)], {}),
    "Eltwise": ("eltwise_param { operation: PROD }", lambda N: [off_zero(N, 3), off_zero(N, 3)], {}),
    "EuclideanLoss": ("", lambda N: [off_zero(N, 3), off_zero(N, 3)], {}),
    "Flatten": ("", lambda N: [off_zero(N, 2, 3)], {}),
    "HandAugment": (
        "hand_augment_param { rotation: 20 scale: 0.1 shift: 1 depth: 0.1 }",
        lambda N: [off_zero(N, 1, 6, 6), off_zero(N, 6)],
        {"tops": 2, "wanted": [False, False]},
    ),
    "HandModel": ("", lambda N: [off_zero(N, 47)], {}),
    "InnerProduct": (
        'inner_product_param { num_output: 2 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(N, 2, 3)],
        {},
    ),
    "PhysLimit": ("", lambda N: [3 * off_zero(N, 47)], {}),
    "Pooling": ("pooling_param { kernel_size: 2 stride: 2 }", lambda N: [different(N, 2, 5, 3)], {}),
    "Power": ("power_param { power: 2 shift: 3 }", lambda N: [off_zero(N, 3)], {}),
    "ReLU": ("", lambda N: [off_zero(N, 3)], {}),
    "Reshape": ("reshape_param { shape { dim: 0 dim: -1 } }", lambda N: [off_zero(N, 2, 3)], {}),
    "Scale": ("scale_param { bias_term: true }", lambda N: [off_zero(N, 2, 3)], {}),
    "Sigmoid": ("", lambda N: [off_zero(N, 3)], {}),
    "Silence": ("", lambda N: [off_zero(N, 3)], {"tops": 0}),
    "Slice": ("", lambda N: [off_zero(N, 4)], {"tops": 2}),
    "SmoothL1Loss": ("smooth_l1_loss_param { sigma: 1.3 }", lambda N: [off_zero(N, 3), off_zero(N, 3)], {}),
    "Softmax": ("", lambda N: [off_zero(N, 3)], {}),
    "SoftmaxWithLoss": ("", lambda N: [off_zero(N, 3), RNG.integers(0, 3, N)], {"wanted": [True, False]}),
    "Split": ("", lambda N: [off_zero(N, 3)], {"tops": 2}),
    "TanH": ("", lambda N: [off_zero(N, 3)], {}),
}
SOURCES = {"DummyData", "HDF5Data", "Input"}  # no bottoms: their own tests say all there is
CONTRACT = {name for name, _ in inspect.getmembers(Layer)}
EXTRAS = {
    "HDF5Data": {"read", "rewind", "row", "use_batch_size"},
    "InnerProduct": {"weight"},
}  # documented, for tools or for their own use

every_type = pytest.mark.parametrize("name", list(CASES))


def types(**attributes: bool) -> pytest.MarkDecorator:
    """Types with cases whose class attributes are these."""
    names = [n for n in CASES if all(getattr(LAYER_TYPES[n], a) == v for a, v in attributes.items())]
    return pytest.mark.parametrize("name", names)


def made(name: str, N: int = 2) -> tuple[Layer, list[np.ndarray]]:
    """A layer of this type, and bottoms for N items."""
    options, bottoms, more = CASES[name]
    arrays = bottoms(N)
    return gradcheck.make_layer(f'type: "{name}" {options}', arrays, more.get("tops", 1)), arrays


def test_every_type_has_a_case() -> None:
    """A new layer type must be entered above."""
    assert set(CASES) | SOURCES == set(LAYER_TYPES)


@every_type
def test_the_gradient_agrees_with_differences(name: str) -> None:
    """In TRAIN, with bottoms off kinks."""
    layer, bottoms = made(name)
    gradcheck.check(layer, bottoms, **CASES[name][2])


@every_type
def test_another_batch_size_works(name: str) -> None:
    """More items, then fewer, on the same layer: shapes of tops and gradients follow."""
    layer, _ = made(name)
    for N in (4, 1):
        gradcheck.check(layer, CASES[name][1](N), **CASES[name][2])


@types(in_place=True)
def test_in_place_if_it_says_so(name: str) -> None:
    """The first top may be the first bottom: the same values, the same gradients."""
    layer, bottoms = made(name)
    options = CASES[name][2]
    if options.get("tops", 1) == 1:
        gradcheck.check(layer, bottoms, in_place=True, **options)
    apart, together = (forward(layer, bottoms, options.get("tops", 1), in_place) for in_place in (False, True))
    assert all(np.array_equal(a, b) for a, b in zip(apart, together))


def forward(layer: Layer, arrays: list[np.ndarray], tops: int, in_place: bool) -> list[np.ndarray]:
    """The tops, each its own blob or all the bottoms'."""
    bottom = Blobs([Blob(np.shape(x), np.float64) for x in arrays])
    for blob, x in zip(bottom, arrays):
        blob.data[...] = x
    top = Blobs(bottom[:tops]) if in_place else Blobs([Blob((), np.float64) for _ in range(tops)])
    start = layer.state()
    layer.reshape(bottom, top)
    layer.forward(bottom, top)
    layer.restore(start)
    return [blob.data for blob in top]


@types(batchwise=True)
def test_a_batchwise_layer_treats_every_item_alone(name: str) -> None:
    """Item n of a top depends on item n of the bottoms only; that is what slices rely on."""
    layer, bottoms = made(name, 5)
    tops = CASES[name][2].get("tops", 1)
    whole = forward(layer, bottoms, tops, False)
    for i in range(5):
        alone = forward(layer, [x[i : i + 1] for x in bottoms], tops, False)
        assert all(np.allclose(a[0], w[i], rtol=1e-13, atol=1e-13) for a, w in zip(alone, whole))


@every_type
def test_backward_reads_only_what_it_says(name: str) -> None:
    """With ``reads_bottom`` or ``reads_top`` false, the data may be gone by then."""
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
            for blob in ([] if layer.reads_bottom else bottom) + ([] if layer.reads_top else top):
                blob.data[...] = np.nan
        layer.backward(top, wanted, bottom)
        found.append([blob.diff.copy() for blob, want in zip(bottom, wanted) if want])
    assert all(np.array_equal(a, b) for a, b in zip(*found))


@every_type
def test_only_wanted_gradients_are_written(name: str) -> None:
    """Where propagate_down is false the diff stays as it was."""
    layer, arrays = made(name)
    bottom = Blobs([Blob(np.shape(x), np.float64) for x in arrays])
    top = Blobs([Blob((), np.float64) for _ in range(CASES[name][2].get("tops", 1))])
    for blob, x in zip(bottom, arrays):
        blob.data[...], blob.diff[...] = x, 77
    layer.reshape(bottom, top)
    layer.forward(bottom, top)
    layer.backward(top, [False] * len(bottom), bottom)
    assert all((blob.diff == 77).all() for blob in bottom)


@pytest.mark.parametrize("name", list(LAYER_TYPES))
def test_no_public_method_outside_the_contract(name: str) -> None:
    """A misspelt hook would never be called."""
    cls = LAYER_TYPES[name]
    public = {n for n, value in inspect.getmembers(cls) if callable(value) and not n.startswith("_")}
    assert public - CONTRACT - {"param_type"} <= EXTRAS.get(name, set())


@pytest.mark.parametrize("name", list(LAYER_TYPES))
def test_options_are_frozen_dataclasses_with_a_docstring(name: str) -> None:
    """Nobody changes them after the prototxt was read."""
    cls = LAYER_TYPES[name]
    assert cls.param_type.__dataclass_params__.frozen  # type: ignore[attr-defined]
    assert cls.param_type.__doc__
    assert cls.__doc__
