"""Blobs of Split, Concat and Slice layers share memory, and no caller can see it."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from fast.shared_memory import adopt
from netlib.blob import Blob
from netlib.net import Net
from netlib.proto import prototxt
from netlib.proto.net_parameter import load_parameter
from tests.support.nets import inputs

BRANCHES = (
    inputs(x=(1, 2, 4, 4))
    + """
layer { name: "a" type: "Power" bottom: "x" top: "a" power_param { shift: 1 } }
layer { name: "b" type: "Power" bottom: "a" top: "b" power_param { scale: 2 } }
layer { name: "ab" type: "Concat" bottom: "a" bottom: "b" top: "ab" }
layer { name: "c" type: "Power" bottom: "ab" top: "c" power_param { scale: 3 } }
layer { name: "parts" type: "Slice" bottom: "c" top: "first" top: "second" slice_param { slice_point: 1 } }
layer { name: "y" type: "Power" bottom: "first" top: "y" power_param { shift: 1 } }
layer { name: "z" type: "Power" bottom: "second" top: "z" power_param { shift: 2 } }
"""
)
SHARED = [("a", "a_a_0_split_0"), ("a", "a_a_0_split_1"), ("a", "ab"), ("b", "ab"), ("c", "first"), ("c", "second")]
X = np.arange(32, dtype=np.float32).reshape(1, 2, 4, 4)


def net(text: str = BRANCHES, engine: str = "fast") -> Net:
    """The net, in TEST."""
    return netlib.Net(load_parameter(prototxt.parse(text)), netlib.TEST, engine=engine)


def shared(of: Net) -> list[tuple[str, str]]:
    """The pairs of ``SHARED`` that share memory, without an access that would separate them."""
    pairs = [(pair, [of.blobs[name]._data for name in pair]) for pair in SHARED]
    return [
        pair for pair, (one, other) in pairs if one is not None and other is not None and np.shares_memory(one, other)
    ]


def assert_same(one: Net, other: Net) -> None:
    """All blobs of two nets are equal."""
    for name in one.blobs:
        np.testing.assert_array_equal(one.blobs[name].data, other.blobs[name].data, err_msg=name)


def test_blobs_that_share_memory() -> None:
    """The tops of a Split, the bottoms of a Concat and the tops of a Slice are parts of one array each."""
    fast, plain = net(), net(engine="plain")
    for factor in (1, 2):
        fast.forward(x=factor * X)
        plain.forward(x=factor * X)
        assert shared(fast) == SHARED
    assert_same(plain, fast)


def test_adopt_takes_an_array_of_the_right_kind_only() -> None:
    """``adopt`` uses an array of the right shape and dtype without a copy, and rejects others."""
    blob, array = Blob((2, 3)), np.ones((2, 3), np.float32)
    adopt(blob, array)
    assert blob.data.base is array
    for wrong in (np.ones((3, 2), np.float32), np.ones((2, 3))):
        with pytest.raises(ValueError, match="expected an array"):
            adopt(blob, wrong)


def test_another_number_of_items() -> None:
    """Two items run in slices, which share no memory with the whole batch; one item shares it again."""
    fast, plain = net(), net(engine="plain")
    for x in (X, np.concatenate([X, -X]), X):
        fast.forward(x=x)
        plain.forward(x=x)
        assert shared(fast) == (SHARED if len(x) == 1 else [])
    assert_same(plain, fast)


def test_parts_that_are_not_adjacent() -> None:
    """The bottoms of a Concat along the rows are no parts of its top in memory if there are several channels."""
    text = BRANCHES.replace('top: "ab"', 'top: "ab" concat_param { axis: 2 }')
    fast, plain = net(text), net(text, "plain")
    fast.forward(x=X)
    plain.forward(x=X)
    assert shared(fast) == [pair for pair in SHARED if pair[1] != "ab"]
    assert_same(plain, fast)


def test_blobs_that_later_run_in_slices() -> None:
    """A blob that shared memory for one item is computed again at an access, after it ran in slices for several."""
    text = (
        inputs(x=(1, 1, 6, 6))
        + """
        layer { name: "a" type: "Convolution" bottom: "x" top: "a"
                convolution_param { num_output: 2 kernel_size: 3 weight_filler { type: "xavier" } } }
        layer { name: "relu" type: "ReLU" bottom: "a" top: "a" }
        layer { name: "b" type: "Power" bottom: "a" top: "b" power_param { scale: 2 } }
        layer { name: "c" type: "Reduction" bottom: "a" top: "c" }
    """
    )
    x = np.random.default_rng(0).normal(size=(3, 1, 6, 6)).astype(np.float32)
    fast, plain = net(text), net(text, "plain")
    for name, (param, _) in plain.params.items():
        param.data[...] = fast.params[name][0].data
    for count in (1, 3, 3):
        fast.forward(x=x[:count])
        plain.forward(x=x[:count])
    for name in plain.blobs:
        np.testing.assert_allclose(fast.blobs[name].data, plain.blobs[name].data, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("name", ["a", "a_a_0_split_0", "a_a_0_split_1", "b", "ab", "c", "first", "second"])
def test_a_written_blob(name: str) -> None:
    """A value written to one blob is read by its own readers only, also in a part of a pass."""
    nets = fast, plain = net(), net(engine="plain")
    for start in ("b", "ab", "c", "parts", "y", "z"):
        for one in nets:
            one.forward(x=X)
            one.blobs[name].data[...] = 7
            one.forward(start=start)
        assert_same(plain, fast)


@pytest.mark.parametrize("name", ["a", "ab", "second"])
def test_an_accessed_array(name: str) -> None:
    """An accessed blob has memory of its own, which is not copied again, and the next pass writes to it."""
    fast, plain = net(), net(engine="plain")
    fast.forward(x=X)
    array = fast.blobs[name].data
    assert shared(fast) == [pair for pair in SHARED if name not in pair]
    fast.forward(x=2 * X)
    plain.forward(x=2 * X)
    assert fast.blobs[name].data.base is array.base
    assert_same(plain, fast)


@pytest.mark.parametrize(
    ("name", "behind", "apart"),
    [
        ("b", "b", []),  # before the Concat reads it
        ("ab", "ab", [("a", "ab"), ("b", "ab")]),
        ("second", "parts", [("c", "second")]),
    ],
)
def test_an_overwritten_blob(name: str, behind: str, apart: list[tuple[str, str]]) -> None:
    """A blob that a layer in place overwrites does not share memory with one that still has the old values."""
    in_place = f'layer {{ name: "over" type: "TanH" bottom: "{name}" top: "{name}" }}'
    lines = BRANCHES.splitlines()
    place = next(number for number, line in enumerate(lines) if f'name: "{behind}"' in line)
    text = "\n".join([*lines[: place + 1], in_place, *lines[place + 1 :]])
    fast, plain = net(text), net(text, "plain")
    for factor in (1, 2):
        fast.forward(x=factor * X)
        plain.forward(x=factor * X)
        assert shared(fast) == [pair for pair in SHARED if pair not in apart]
    assert_same(plain, fast)
