"""PSROIPooling: regions, bins and the maps of each bin."""

import math

import numpy as np
import pytest


def text(dim=1, group=2, scale=1.0):
    options = f"spatial_scale: {scale} output_dim: {dim} group_size: {group}"
    return f'type: "PSROIPooling" psroi_pooling_param {{ {options} }}'


X = np.arange(4 * 24.0).reshape(1, 4, 4, 6)  # map c of pixel (h, w) has 24 c + 6 h + w


def test_by_hand(run):
    """Each of the four bins of rows 1 to 2 and columns 1 to 4 is the mean of one row and two columns of another map."""
    done = run(text(), X, [[0, 1, 1, 4, 2]])
    assert done.y.tolist() == [[[[7.5, 24 + 9.5], [48 + 13.5, 72 + 15.5]]]]
    dx, drois = done.backward([[[[2, 4], [6, 8]]]])
    want = np.zeros((4, 4, 6))
    want[0, 1, 1:3], want[1, 1, 3:5], want[2, 2, 1:3], want[3, 2, 3:5] = 1, 2, 3, 4
    assert np.array_equal(dx[0], want)
    assert not drois.any()


def test_the_channels_of_the_top_follow_each_other(run):
    """Channel k of the top reads the maps from k G G on, which differ from bin to bin."""
    x = np.arange(8.0).reshape(1, 8, 1, 1)
    assert run(text(2), x, [[0, 0, 0, 0, 0]]).y.ravel().tolist() == list(range(8))


def test_corners_are_rounded_before_they_are_scaled(run):
    """Corners 1.5 and 5.4 are 2 and 5; at a scale of 1/2 the region covers columns 1 and 2."""
    x = np.arange(6.0).reshape(1, 1, 1, 6)
    assert run(text(group=1, scale=0.5), x, [[0, 1.5, 0, 5.4, 0]]).y.ravel().tolist() == [1.5]


def test_bins_cover_every_pixel_that_they_touch(run):
    """Three columns in two bins share the middle one, whose gradients are added."""
    x = np.tile([1.0, 2, 6], 4).reshape(1, 4, 1, 3)
    done = run(text(), x, [[0, 0, 0, 2, 0]])
    assert done.y.ravel().tolist() == [1.5, 4, 1.5, 4]
    assert done.backward([[[[2, 0], [0, 0]]]])[0][0, 0].tolist() == [[1, 1, 0]]


def test_an_empty_bin_is_zero_and_has_no_gradient(run):
    """A bin outside the map is 0 and has no gradient."""
    done = run(text(), X + 1, [[0, 90, 90, 99, 99]])
    assert not done.y.any()
    assert not done.backward(np.ones((1, 1, 2, 2)))[0].any()


def test_a_region_with_exchanged_corners_has_a_size(run):
    """A region whose end is before its beginning has bins of 0.05, so that it covers the pixel of its beginning."""
    assert run(text(), X, [[0, 3, 2, 1, 0]]).y.ravel().tolist() == [15, 39, 63, 87]


def test_any_region_gives_what_plain_loops_give(run, rng):
    x, G = rng.normal(size=(2, 18, 7, 9)), 3
    rois = np.column_stack([rng.integers(0, 2, 40), rng.integers(-8, 40, (40, 4))])
    y = run(text(2, G, 0.25), x, rois).y
    for r, k, i, j in np.ndindex(40, 2, G, G):
        spans = []
        for first, last, bin_ in ((2, 4, i), (1, 3, j)):
            begin = rois[r, first] / 4
            length = max((rois[r, last] + 1) / 4 - begin, 0.1) / G
            low, high = begin + bin_ * length, begin + (bin_ + 1) * length
            low, high = (round(v) if abs(v - round(v)) < 1e-6 else v for v in (low, high))
            spans.append(slice(max(math.floor(low), 0), max(math.ceil(high), 0)))
        window = x[int(rois[r, 0]), (k * G + i) * G + j, spans[0], spans[1]]
        assert y[r, k, i, j] == pytest.approx(window.mean() if window.size else 0, abs=1e-6)
