"""ROIPooling: regions, rounding and bins."""

import math

import numpy as np
import pytest


def text(h=2, w=2, scale=1.0):
    return f'type: "ROIPooling" roi_pooling_param {{ pooled_h: {h} pooled_w: {w} spatial_scale: {scale} }}'


X = np.arange(24.0).reshape(1, 1, 4, 6)


def test_by_hand(run):
    """A region of rows 1 to 2 and columns 1 to 4, ends included, has bins of 1 x 2."""
    done = run(text(), X, [[0, 1, 1, 4, 2]])
    assert done.y.tolist() == [[[[8, 10], [14, 16]]]]
    dx, drois = done.backward([[[[1, 2], [3, 4]]]])
    want = np.zeros(24)
    want[[8, 10, 14, 16]] = 1, 2, 3, 4
    assert dx.ravel().tolist() == want.tolist()
    assert not drois.any()


def test_bins_overlap_where_the_grid_does_not_divide_the_region(run):
    """Three columns in two bins overlap: 0 and 1, 1 and 2. The gradients of a shared pixel are added."""
    x = np.array([1.0, 9, 2]).reshape(1, 1, 1, 3)
    done = run(text(1, 2), x, [[0, 0, 0, 2, 0]])
    assert done.y.tolist() == [[[[9, 9]]]]
    assert done.backward([[[[1, 2]]]])[0].ravel().tolist() == [0, 3, 0]


def test_the_first_of_equal_values_wins(run):
    """The first of equal values, in row order, gets the gradient."""
    done = run(text(1, 1), np.zeros((1, 1, 2, 2)), [[0, 0, 0, 1, 1]])
    assert done.backward([[[[5]]]])[0].ravel().tolist() == [5, 0, 0, 0]


@pytest.mark.parametrize(
    ("corner", "column"), [(0.4, 0), (0.5, 1), (1.5, 2), (2.5, 3), (2.4, 2), (-0.5, None), (-0.4, 0)], ids=str
)
def test_halves_are_rounded_away_from_zero(run, corner, column):
    """Halves are rounded away from zero, not to even; column -1 is outside the map."""
    done = run(text(1, 1), X, [[0, corner, 0, corner, 0]])
    assert done.y.ravel().tolist() == [0.0 if column is None else column]


def test_corners_are_scaled_before_they_are_rounded(run):
    """Corners are scaled before rounding: 3 / 4 gives 1 and 9 / 4 gives 2."""
    assert run(text(1, 1, 0.25), X, [[0, 3, 0, 9, 0]]).y.ravel().tolist() == [2]


def test_a_region_has_at_least_one_row_and_column(run):
    """A region has at least one row and column, even if its corners are swapped."""
    assert run(text(1, 1), X, [[0, 4, 2, 1, 0]]).y.ravel().tolist() == [16]


def test_an_empty_bin_is_zero_and_has_no_gradient(run):
    """A bin outside the map is 0 and has no gradient."""
    done = run(text(1, 2), X - 100, [[0, -2, 0, 1, 0]])
    assert done.y.ravel().tolist() == [0, -99]
    assert done.backward([[[[7, 1]]]])[0].ravel().tolist() == [0, 1] + [0] * 22


def test_each_region_names_its_item(run, rng):
    """Regions may refer to items in any order, and there may be none."""
    x = rng.normal(size=(3, 2, 4, 4))
    done = run(text(1, 1), x, [[2, 0, 0, 3, 3], [0, 0, 0, 3, 3], [2, 0, 0, 3, 3]])
    assert np.array_equal(done.y[..., 0, 0], x[[2, 0, 2]].max(axis=(2, 3)))
    assert run(text(1, 1), x, np.zeros((0, 5))).y.shape == (0, 2, 1, 1)


def test_any_region_gives_what_plain_loops_give(run, rng):
    x, grid = rng.normal(size=(2, 2, 7, 9)), (3, 4)
    rois = np.column_stack([rng.integers(0, 2, 40), rng.uniform(-8, 40, (40, 4))])
    y = run(text(*grid, 0.25), x, rois).y
    for r, i, j in np.ndindex(40, *grid):
        spans = []
        for first, last, k, bins in ((2, 4, i, grid[0]), (1, 3, j, grid[1])):
            begin, end = (math.floor(abs(v) / 4 + 0.5) * (1 if v > 0 else -1) for v in rois[r, [first, last]])
            length = max(end - begin + 1, 1)
            spans.append(slice(max(begin + k * length // bins, 0), max(begin + -(-(k + 1) * length // bins), 0)))
        window = x[int(rois[r, 0]), :, spans[0], spans[1]].reshape(2, -1)
        assert np.array_equal(y[r, :, i, j], window.max(axis=1) if window.size else np.zeros(2))
