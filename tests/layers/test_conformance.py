"""Requirements of every layer type: its gradient, other batch sizes, running in place, and no
misspelt hook.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from layers import LAYER_TYPES
from netlib.net import Net
from netlib.proto.options import block_name
from tests.support.layer_cases import CASES, SOURCES, forward

# The gradient of the regions is 0, but differences are not.
FORCED = {"PSROIPooling": [True, True], "ROIPooling": [True, True]}

every_type = pytest.mark.parametrize("name", list(CASES))


def test_every_type_has_a_case() -> None:
    assert set(CASES) | SOURCES == set(LAYER_TYPES)


@every_type
def test_the_gradient_agrees_with_differences(name: str) -> None:
    """Also for a larger and a smaller batch of the same layer."""
    case = CASES[name]
    bottoms = case.bottoms(2)
    layer = case.layer(bottoms)
    for arrays in (bottoms, case.bottoms(3), case.bottoms(1)):
        case.check(layer, arrays)


@pytest.mark.parametrize("name", [name for name in CASES if LAYER_TYPES[name].in_place])
def test_layers_declared_in_place_compute_the_same_in_place(name: str) -> None:
    case = CASES[name]
    arrays = case.bottoms(2)
    layer = case.layer(arrays)
    if case.tops == 1:
        case.check(layer, arrays, in_place=True)
    _, apart = forward(case, layer, arrays)
    _, together = forward(case, layer, arrays, in_place=True)
    assert all(np.array_equal(a.data, b.data) for a, b in zip(apart, together))


@every_type
def test_only_wanted_gradients_are_written(name: str) -> None:
    """Where propagate_down is false the diff is unchanged."""
    case = CASES[name]
    arrays = case.bottoms(2)
    layer = case.layer(arrays)
    bottom, top = forward(case, layer, arrays)
    for blob in bottom:
        blob.diff[...] = 77
    layer.backward(top, [False] * len(bottom), bottom)
    assert all((blob.diff == 77).all() for blob in bottom)


@every_type
def test_forced_backward_asks_for_the_gradients_that_there_are(
    net_of: Callable[..., Net], name: str
) -> None:
    """``force_backward`` computes the gradient of every bottom that has one, and of no label,
    index or image.
    """
    case = CASES[name]
    arrays = {f"x{i}": np.asarray(x, np.float64) for i, x in enumerate(case.bottoms(2))}
    text = case.net_text(list(arrays.values()))
    net = net_of(f"force_backward: true {text}", dtype=np.float64)
    wanted = FORCED.get(name, case.wanted)
    assert list(net.connections[-1].propagate_down) == wanted
    net.forward(**arrays)
    for blob in arrays:
        net.blobs[blob].diff[...] = np.nan
    net.backward()
    assert [np.isfinite(net.blobs[blob].diff).all() for blob in arrays] == wanted


def test_types_that_share_a_block_read_the_same_in_it() -> None:
    blocks: dict[str, list[Any]] = {}
    for name, cls in LAYER_TYPES.items():
        fields = [
            (f.name, f.type, f.metadata.get("number")) for f in dataclasses.fields(cls.param_type)
        ]
        blocks.setdefault(block_name(cls, name), []).append(fields)
    assert len(blocks["softmax_param"]) == 2
    assert all(fields == each[0] for each in blocks.values() for fields in each)


@pytest.mark.parametrize("name", list(LAYER_TYPES))
def test_options_are_frozen_dataclasses_with_a_docstring(name: str) -> None:
    """Options cannot change after the prototxt is read, and their docstring is not the
    generated one.
    """
    cls = LAYER_TYPES[name]
    assert cls.param_type.__dataclass_params__.frozen  # type: ignore[attr-defined]
    generated = f"{cls.param_type.__name__}("  # the start of a dataclass's generated docstring
    assert not str(cls.param_type.__doc__).startswith(generated)
    assert cls.__doc__
