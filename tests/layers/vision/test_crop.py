"""Crop."""

import numpy as np


def text(options=""):
    return f'type: "Crop" crop_param {{ {options} }}'


X = np.arange(20.0).reshape(1, 1, 4, 5)


def test_by_hand(run):
    """Two rows and three columns are cut out at row 1 and column 2; other pixels have gradient 0."""
    done = run(text("offset: 1 offset: 2"), X, np.zeros((7, 7, 2, 3)))
    assert done.y.tolist() == [[[[7, 8, 9], [12, 13, 14]]]]
    dx, dsize = done.backward([[[[1, 2, 3], [4, 5, 6]]]])
    assert dx[0, 0].tolist() == [[0] * 5, [0, 0, 1, 2, 3], [0, 0, 4, 5, 6], [0] * 5]
    assert not dsize.any()


def test_one_offset_is_for_all_axes(run):
    """A single offset applies to all axes; the default is 0."""
    assert run(text("offset: 1"), X, np.zeros((1, 1, 2, 2))).y.tolist() == [[[[6, 7], [11, 12]]]]
    assert run(text(), X, np.zeros((1, 1, 1, 2))).y.tolist() == [[[[0, 1]]]]


def test_any_axis_may_be_the_first(run):
    """Axes before ``axis`` are kept, and a negative axis counts from the end."""
    x = np.arange(12.0).reshape(2, 3, 2)
    assert run(text("axis: 1 offset: 1 offset: 0"), x, np.zeros((9, 2, 1))).y.tolist() == [[[2], [4]], [[8], [10]]]
    assert run(text("axis: -1 offset: 1"), x, np.zeros((9, 9, 1))).y.tolist() == x[..., 1:].tolist()
