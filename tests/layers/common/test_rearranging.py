"""Layers that copy, join, split and rearrange values: BatchReindex, Concat, Flatten, Permute,
Reshape and others.
"""

import numpy as np
import pytest


def test_no_index_selects_no_item(by_hand):
    by_hand("BatchReindex", [np.zeros((3, 2, 4)), []], [np.zeros((0, 2, 4))])


def like_numpy(layer, *rows):
    """Rows of a layer type, the shape of its bottom, its options, and the function of NumPy
    that it equals.
    """
    return [
        (f'type: "{layer.split()[0]}" {layer.split()[1]} {{ {options} }}', *row)
        for options, *row in rows
    ]


@pytest.mark.parametrize(
    ("text", "shape", "function"),
    [
        *like_numpy(
            "Flatten flatten_param",
            *(
                (options, (2, 3, 4, 5), lambda x, shape=shape: x.reshape(shape))
                for options, shape in (
                    ("", (2, 60)),
                    ("axis: 0", (120,)),
                    ("axis: 2", (2, 3, 20)),
                    ("axis: 1 end_axis: 2", (2, 12, 5)),
                    ("axis: -2", (2, 3, 20)),
                    ("axis: 1 end_axis: -2", (2, 12, 5)),
                    ("axis: 1 end_axis: 1", (2, 3, 4, 5)),
                    ("axis: 2 end_axis: 1", (2, 3, 1, 4, 5)),
                )
            ),
        ),
        *like_numpy(
            "Permute permute_param",
            *(
                (options, (2, 3, 4, 5), lambda x, axes=axes: x.transpose(axes))
                # axes without a place follow in sequence
                for options, axes in (
                    ("", (0, 1, 2, 3)),
                    ("order: 2", (2, 0, 1, 3)),
                    ("order: 3 order: 1", (3, 1, 0, 2)),
                    ("order: 3 order: 2 order: 1 order: 0", (3, 2, 1, 0)),
                )
            ),
        ),
        *like_numpy(
            "Reshape reshape_param",
            *(
                (options, (2, 3, 4), lambda x, shape=shape: x.reshape(shape))
                for options, shape in (
                    ("shape { dim: 6 dim: 4 }", (6, 4)),
                    ("shape { dim: 0 dim: -1 }", (2, 12)),
                    ("shape { dim: 0 dim: 0 dim: 2 dim: 2 }", (2, 3, 2, 2)),
                    ("shape { dim: -1 }", (24,)),
                    ("shape { dim: 12 } axis: 1", (2, 12)),
                    ("shape { dim: 3 dim: 1 } axis: 1 num_axes: 1", (2, 3, 1, 4)),
                    ("shape { dim: 2 dim: 2 } axis: -2", (2, 3, 2, 2)),
                    ("shape { dim: 1 dim: 1 } axis: -1", (2, 3, 4, 1, 1)),
                    ("shape { dim: 1 } axis: 0 num_axes: 0", (1, 2, 3, 4)),
                    ("shape { } axis: 1 num_axes: 0", (2, 3, 4)),
                )
            ),
        ),
        *like_numpy(
            "Tile tile_param",
            *(
                (
                    f"tiles: 3 axis: {axis}",
                    (2, 3, 4),
                    lambda x, axis=axis: np.concatenate([x] * 3, axis),
                )
                for axis in (0, 1, 2, -3)
            ),
        ),
    ],
)
def test_values_and_gradients_are_those_of_numpy(run, rng, text, shape, function):
    x = rng.normal(size=shape)
    done = run(text, x)
    assert np.array_equal(done.y, function(x))
    dy, dx = rng.normal(size=done.y.shape), np.zeros(x.size)
    np.add.at(dx, function(np.arange(x.size).reshape(shape)).ravel(), dy.ravel())
    np.testing.assert_allclose(done.backward(dy)[0], dx.reshape(shape))


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
