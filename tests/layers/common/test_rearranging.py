"""Layers that copy, join, split and rearrange values: BatchReindex, Concat, Flatten, Permute,
Reshape and others.
"""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.support.tables import lines_of, shape_of


def test_no_index_selects_no_item(by_hand):
    by_hand("BatchReindex", [np.zeros((3, 2, 4)), []], [np.zeros((0, 2, 4))])


FUNCTIONS = {
    "reshape": np.reshape,
    "transpose": np.transpose,
    "thrice": lambda x, axes: np.concatenate([x] * 3, *axes),
}


@pytest.mark.parametrize(
    ("layer", "shape", "function"), lines_of(Path(__file__).with_name("like_numpy.txt"))
)
def test_values_and_gradients_are_those_of_numpy(run, rng, layer, shape, function):
    kind, _, options = layer.partition(" ")
    name, *numbers = function.split()
    compute, given = FUNCTIONS[name], [int(number) for number in numbers]
    x = rng.normal(size=shape_of(shape))
    done = run(f'type: "{kind}" {options}', x)
    assert_array_equal(done.y, compute(x, given))
    dy, dx = rng.normal(size=done.y.shape), np.zeros(x.size)
    np.add.at(dx, compute(np.arange(x.size).reshape(x.shape), given).ravel(), dy.ravel())
    assert_allclose(done.backward(dy)[0], dx.reshape(x.shape))


@pytest.mark.parametrize(
    "shape", [(2, 6), (2, 6, 3), (2, 6, 2, 3), (1, 6, 2, 1, 2), (0, 6, 2, 2)], ids=str
)
def test_shuffle_channel_any_number_of_axes(run, rng, shape):
    """Shuffling with G and then with C / G groups is the identity, for items, rows and columns
    of any number.
    """
    x = rng.normal(size=shape)
    two, three = (
        f'type: "ShuffleChannel" shuffle_channel_param {{ group: {group} }}' for group in (2, 3)
    )
    assert np.array_equal(run(three, run(two, x).y).y, x)


def test_silence_it_reads_and_gives_no_gradient(run):
    done = run('type: "Silence"', np.ones(3), np.ones((2, 2)), tops=0)
    done.bottom[0].diff[...] = np.nan
    assert [dx.tolist() for dx in done.backward()] == [[0, 0, 0], [[0, 0], [0, 0]]]


def test_silence_removes_its_bottoms_from_the_outputs(net_of):
    text = 'layer { name: "x" type: "Input" top: "x" top: "y" input_param { shape { dim: 2 } } } '
    assert net_of(text).outputs == ["x", "y"]
    assert net_of(text + 'layer { name: "s" type: "Silence" bottom: "x" }').outputs == ["y"]


@pytest.mark.parametrize(
    ("options", "tops", "sizes", "axis"),
    [
        ("", 3, [2, 2, 2], 1),
        ("slice_point: 1 slice_point: 4", 3, [1, 3, 2], 1),
        ("axis: 0", 2, [2, 2], 0),
        ("axis: -1 slice_point: 3", 2, [3, 2], 2),
        ("slice_dim: 0 slice_point: 1", 2, [1, 3], 0),
        ("", 1, [6], 1),
        ("slice_point: 2 slice_point: 6", 3, [2, 4, 0], 1),
    ],
)
def test_slice_parts(run, rng, options, tops, sizes, axis):
    x = rng.normal(size=(4, 6, 5))
    done = run(f'type: "Slice" slice_param {{ {options} }}', x, tops=tops)
    assert [y.shape[axis] for y in done.ys] == sizes
    assert np.array_equal(np.concatenate(done.ys, axis), x)
    parts = [rng.normal(size=y.shape) for y in done.ys]
    assert np.array_equal(done.backward(*parts)[0], np.concatenate(parts, axis))
