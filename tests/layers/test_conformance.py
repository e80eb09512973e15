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
from netlib import gradcheck
from netlib.blob import Blob, Blobs
from netlib.net import Net
from netlib.proto.options import block_name
from tests.support.layer_cases import CASES, SOURCES, forward, made, net_text

# The gradient of the regions is 0, but differences are not.
FORCED = {"PSROIPooling": [True, True], "ROIPooling": [True, True]}

every_type = pytest.mark.parametrize("name", list(CASES))


def test_every_type_has_a_case() -> None:
    assert set(CASES) | SOURCES == set(LAYER_TYPES)


@every_type
def test_the_gradient_agrees_with_differences(name: str) -> None:
    """Also for a larger and a smaller batch of the same layer."""
    layer, bottoms = made(name)
    for arrays in (bottoms, CASES[name][1](3), CASES[name][1](1)):
        gradcheck.check(layer, arrays, **CASES[name][2])


@pytest.mark.parametrize("name", [name for name in CASES if LAYER_TYPES[name].in_place])
def test_layers_declared_in_place_compute_the_same_in_place(name: str) -> None:
    layer, bottoms = made(name)
    options = CASES[name][2]
    if options.get("tops", 1) == 1:
        gradcheck.check(layer, bottoms, in_place=True, **options)
    apart, together = (
        forward(layer, bottoms, options.get("tops", 1), in_place) for in_place in (False, True)
    )
    assert all(np.array_equal(a, b) for a, b in zip(apart, together))


@every_type
def test_only_wanted_gradients_are_written(name: str) -> None:
    """Where propagate_down is false the diff is unchanged."""
    layer, arrays = made(name)
    bottom = Blobs([Blob(np.shape(x), np.float64) for x in arrays])
    top = Blobs([Blob((), np.float64) for _ in range(CASES[name][2].get("tops", 1))])
    for blob, x in zip(bottom, arrays):
        blob.data[...], blob.diff[...] = x, 77
    layer.reshape(bottom, top)
    layer.forward(bottom, top)
    layer.backward(top, [False] * len(bottom), bottom)
    assert all((blob.diff == 77).all() for blob in bottom)


@every_type
def test_forced_backward_asks_for_the_gradients_that_there_are(
    net_of: Callable[..., Net], name: str
) -> None:
    """``force_backward`` computes the gradient of every bottom that has one, and of no label,
    index or image.
    """
    _, bottoms, more = CASES[name]
    arrays = {f"x{i}": np.asarray(x, np.float64) for i, x in enumerate(bottoms(2))}
    text = net_text(name, list(arrays.values()))
    net = net_of(f"force_backward: true {text}", dtype=np.float64)
    wanted = FORCED.get(name, more.get("wanted", [True] * len(arrays)))
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
