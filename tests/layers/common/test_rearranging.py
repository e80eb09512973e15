"""Layers that copy, join, split and rearrange values: BatchReindex, Concat, Flatten, Permute, Reshape and others."""

import numpy as np
import pytest

X = [[1.0, 2], [3, 4], [5, 6]]


def test_batch_reindex_by_hand(run):
    """Items may be selected in any order and repeatedly; the gradients of repeated items are added."""
    done = run('type: "BatchReindex"', X, [2, 0, 2, 0])
    assert done.y.tolist() == [[5, 6], [1, 2], [5, 6], [1, 2]]
    dx, _ = done.backward([[1, 2], [3, 4], [10, 20], [30, 40]], wanted=[True, False])
    assert dx.tolist() == [[33, 44], [0, 0], [11, 22]]


def test_batch_reindex_more_axes_and_no_items(run, rng):
    """The list determines the number of items, which may be 0; fractions are truncated, as in Caffe."""
    x = rng.normal(size=(3, 2, 4))
    assert np.array_equal(run('type: "BatchReindex"', x, [1.75]).y, x[1:2])
    assert run('type: "BatchReindex"', x, []).y.shape == (0, 2, 4)


@pytest.mark.parametrize("axis", [0, 1, 2, -1])
def test_concat_one_after_the_other(run, rng, axis):
    """Bottoms are concatenated along any axis; the gradient is split the same way."""
    a, b, c = (rng.normal(size=(2, 3, 4)) for _ in range(3))
    done = run(f'type: "Concat" concat_param {{ axis: {axis} }}', a, b, c)
    assert np.array_equal(done.y, np.concatenate([a, b, c], axis))
    dy = rng.normal(size=done.y.shape)
    for part, want in zip(done.backward(dy), np.split(dy, 3, axis)):
        assert np.array_equal(part, want)


def test_concat_sizes_may_differ_along_the_axis(run):
    """Sizes may differ along the axis, which may be set by its older name concat_dim."""
    done = run('type: "Concat" concat_param { concat_dim: 1 }', [[1], [2]], [[3, 4], [5, 6]])
    assert done.y.tolist() == [[1, 3, 4], [2, 5, 6]]


def test_concat_one_bottom(run, check, rng):
    """A single bottom is copied to the top."""
    x = rng.normal(size=(2, 3))
    assert np.array_equal(run('type: "Concat"', x).y, x)
    check('type: "Concat"', x)


def test_concat_an_empty_bottom(run):
    assert run('type: "Concat"', np.ones((2, 3)), np.ones((2, 0))).y.shape == (2, 3)


@pytest.mark.parametrize(
    ("options", "shape"),
    [("", (2, 60)), ("axis: 0", (120,)), ("axis: 2", (2, 3, 20)), ("axis: 1 end_axis: 2", (2, 12, 5)),
     ("axis: -2", (2, 3, 20)), ("axis: 1 end_axis: -2", (2, 12, 5)), ("axis: 1 end_axis: 1", (2, 3, 4, 5)),
     ("axis: 2 end_axis: 1", (2, 3, 1, 4, 5))],
)
def test_flatten_axes_are_joined(run, rng, options, shape):
    """The values keep their order, and the gradient has the shape of the bottom."""
    x = rng.normal(size=(2, 3, 4, 5))
    done = run(f'type: "Flatten" flatten_param {{ {options} }}', x)
    assert np.array_equal(done.y, x.reshape(shape))
    dy = rng.normal(size=shape)
    assert np.array_equal(done.backward(dy)[0], dy.reshape(x.shape))


def permute(*order):
    return f'type: "Permute" permute_param {{ {" ".join(f"order: {axis}" for axis in order)} }}'


def test_permute_by_hand(run):
    """The numbers of one position become neighbours: y[n, h, w, c] = x[n, c, h, w]."""
    done = run(permute(0, 2, 3, 1), [[[[1, 2, 3]], [[4, 5, 6]]]])
    assert done.y.tolist() == [[[[1, 4], [2, 5], [3, 6]]]]
    assert done.backward([[[[1, 2], [3, 4], [5, 6]]]])[0].tolist() == [[[[1, 3, 5]], [[2, 4, 6]]]]


@pytest.mark.parametrize(
    ("order", "axes"), [((), (0, 1, 2, 3)), ((2,), (2, 0, 1, 3)), ((3, 1), (3, 1, 0, 2)), ((3, 2, 1, 0),) * 2], ids=str
)
def test_permute_axes_without_a_place_follow_in_sequence(run, rng, order, axes):
    """Axes that the order does not name follow; without an order y = x."""
    x = rng.normal(size=(2, 3, 4, 5))
    done = run(permute(*order), x)
    assert np.array_equal(done.y, np.moveaxis(x, axes, range(4)))
    dy = rng.normal(size=done.y.shape)
    assert np.array_equal(done.backward(dy)[0], np.moveaxis(dy, range(4), axes))


@pytest.mark.parametrize(("options", "shape"), [
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
])
def test_reshape_shapes(run, rng, options, shape):
    """0 copies a size, -1 is inferred, and axis and num_axes select the replaced axes."""
    x = rng.normal(size=(2, 3, 4))
    done = run(f'type: "Reshape" reshape_param {{ {options} }}', x)
    assert np.array_equal(done.y, x.reshape(shape))
    dy = rng.normal(size=shape)
    assert np.array_equal(done.backward(dy)[0], dy.reshape(x.shape))


def shuffle_channel(group):
    return f'type: "ShuffleChannel" shuffle_channel_param {{ group: {group} }}'


def test_shuffle_channel_by_hand(run):
    """The first channels of all groups come first, then the second ones."""
    x = np.arange(6.0).reshape(1, 6, 1, 1)
    done = run(shuffle_channel(2), x)
    assert done.y.ravel().tolist() == [0, 3, 1, 4, 2, 5]
    assert done.backward(10 * done.y)[0].ravel().tolist() == [0, 10, 20, 30, 40, 50]
    assert run(shuffle_channel(3), x).y.ravel().tolist() == [0, 2, 4, 1, 3, 5]


def test_shuffle_channel_one_group_and_one_channel_per_group_change_nothing(run, rng):
    x = rng.normal(size=(2, 4, 3))
    for layer in ('type: "ShuffleChannel"', shuffle_channel(1), shuffle_channel(4)):
        assert np.array_equal(run(layer, x).y, x)


@pytest.mark.parametrize("shape", [(2, 6), (2, 6, 3), (2, 6, 2, 3), (1, 6, 2, 1, 2), (0, 6, 2, 2)], ids=str)
def test_shuffle_channel_any_number_of_axes(run, rng, shape):
    """Shuffling with G and then with C / G groups is the identity, for items, rows and columns of any number."""
    x = rng.normal(size=shape)
    assert np.array_equal(run(shuffle_channel(3), run(shuffle_channel(2), x).y).y, x)


def test_silence_it_reads_and_gives_no_gradient(run):
    """Every element of the bottom diffs is set to 0."""
    done = run('type: "Silence"', np.ones(3), np.ones((2, 2)), tops=0)
    done.bottom[0].diff[...] = np.nan
    assert [dx.tolist() for dx in done.backward()] == [[0, 0, 0], [[0, 0], [0, 0]]]


def test_silence_what_it_reads_is_no_output(net_of):
    """A blob read by Silence is not an output of the net."""
    text = 'layer { name: "x" type: "Input" top: "x" top: "y" input_param { shape { dim: 2 } } } '
    assert net_of(text).outputs == ["x", "y"]
    assert net_of(text + 'layer { name: "s" type: "Silence" bottom: "x" }').outputs == ["y"]


@pytest.mark.parametrize(
    ("options", "tops", "sizes", "axis"),
    [("", 3, [2, 2, 2], 1), ("slice_point: 1 slice_point: 4", 3, [1, 3, 2], 1), ("axis: 0", 2, [2, 2], 0),
     ("axis: -1 slice_point: 3", 2, [3, 2], 2), ("slice_dim: 0 slice_point: 1", 2, [1, 3], 0), ("", 1, [6], 1),
     ("slice_point: 2 slice_point: 6", 3, [2, 4, 0], 1)],
)
def test_slice_parts(run, rng, options, tops, sizes, axis):
    """The bottom is split into equal parts or at the slice points; the gradient is concatenated."""
    x = rng.normal(size=(4, 6, 5))
    done = run(f'type: "Slice" slice_param {{ {options} }}', x, tops=tops)
    assert [y.shape[axis] for y in done.ys] == sizes
    assert np.array_equal(np.concatenate(done.ys, axis), x)
    parts = [rng.normal(size=y.shape) for y in done.ys]
    assert np.array_equal(done.backward(*parts)[0], np.concatenate(parts, axis))


def test_split_copies_and_sums(run, rng):
    """Every top is a copy of the bottom; the bottom's gradient is the sum of the tops' gradients."""
    x, dy = rng.normal(size=(2, 3)), rng.normal(size=(3, 2, 3))
    done = run('type: "Split"', x, tops=3)
    assert all(np.array_equal(y, x) for y in done.ys)
    assert np.allclose(done.backward(*dy)[0], dy.sum(axis=0))


def test_tile_by_hand(run):
    """The row is repeated as a whole; the gradients of the copies are added."""
    done = run('type: "Tile" tile_param { tiles: 2 }', [[1.0, 2], [3, 4]])
    assert done.y.tolist() == [[1, 2, 1, 2], [3, 4, 3, 4]]
    assert done.backward([[1, 2, 10, 20], [3, 4, 30, 40]])[0].tolist() == [[11, 22], [33, 44]]


@pytest.mark.parametrize(("axis", "shape"), [(0, (6, 3, 4)), (1, (2, 9, 4)), (2, (2, 3, 12)), (-3, (6, 3, 4))])
def test_tile_any_axis(run, check, rng, axis, shape):
    """Tiling along any axis equals numpy.tile."""
    x = rng.normal(size=(2, 3, 4))
    text = f'type: "Tile" tile_param {{ axis: {axis} tiles: 3 }}'
    done = run(text, x)
    repeats = [1, 1, 1]
    repeats[axis] = 3
    assert np.array_equal(done.y, np.tile(x, repeats))
    assert done.y.shape == shape
    check(text, x)


def test_tiles_of_nothing(run):
    """Tiling an empty blob takes no time or memory."""
    assert run('type: "Tile" tile_param { tiles: 2147483647 }', np.zeros((0, 1))).y.shape == (0, 2147483647)
