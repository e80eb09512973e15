"""ROIPooling and PSROIPooling: regions, rounding and bins, by hand and compared with loops."""

import math

import numpy as np
import pytest


def roi(h=2, w=2, scale=1.0):
    return f"ROIPooling roi_pooling_param {{ pooled_h: {h} pooled_w: {w} spatial_scale: {scale} }}"


def psroi(dim=1, group=2, scale=1.0):
    return f"PSROIPooling psroi_pooling_param {{ spatial_scale: {scale} output_dim: {dim} group_size: {group} }}"


def filled(x, values=()):
    """Return zeros of the shape of x, with these values at their numbers in it."""
    array = np.zeros(np.shape(x))
    for number, value in dict(values).items():
        array.flat[number] = value
    return array


X = np.arange(24.0).reshape(1, 1, 4, 6)
MAPS = np.arange(96.0).reshape(1, 4, 4, 6)  # map c of pixel (h, w) has 24 c + 6 h + w
THREE = np.tile([1.0, 2, 6], 4).reshape(1, 4, 1, 3)
LINE = np.arange(6.0).reshape(1, 1, 1, 6)
EQUAL = np.zeros((1, 1, 2, 2))

# type and options, image, region, top, dy, dx
BY_HAND = [
    # rows 1 to 2 and columns 1 to 4, ends included, have bins of 1 x 2
    (
        roi(),
        X,
        [0, 1, 1, 4, 2],
        [[8, 10], [14, 16]],
        [[1, 2], [3, 4]],
        filled(X, {8: 1, 10: 2, 14: 3, 16: 4}),
    ),
    # three columns in two bins: 0 and 1, 1 and 2; the gradients of a shared pixel are added
    (
        roi(1, 2),
        np.reshape([1.0, 9, 2], (1, 1, 1, 3)),
        [0, 0, 0, 2, 0],
        [[9, 9]],
        [[1, 2]],
        [[[[0, 3, 0]]]],
    ),
    # the first of equal values
    (roi(1, 1), EQUAL, [0, 0, 0, 1, 1], [[0]], [[5]], filled(EQUAL, {0: 5})),
    # halves are rounded away from zero
    *(
        (roi(1, 1), X, [0, corner, 0, corner, 0], [[column]], [[0]], filled(X))
        for corner, column in ((0.4, 0), (0.5, 1), (1.5, 2), (2.5, 3), (2.4, 2), (-0.4, 0))
    ),
    (roi(1, 1), X + 1, [0, -0.5, 0, -0.5, 0], [[0]], [[1]], filled(X)),  # column -1 is outside
    # scaled before rounding: 3 / 4 and 9 / 4
    (roi(1, 1, 0.25), X, [0, 3, 0, 9, 0], [[2]], [[0]], filled(X)),
    (roi(1, 1), X, [0, 4, 2, 1, 0], [[16]], [[0]], filled(X)),  # at least one row and column
    (roi(1, 2), X - 100, [0, -2, 0, 1, 0], [[0, -99]], [[7, 1]], filled(X, {1: 1})),  # an empty bin
    # each of four bins of rows 1 to 2 and columns 1 to 4 is the mean of one row and two columns
    # of another map
    (
        psroi(),
        MAPS,
        [0, 1, 1, 4, 2],
        [[7.5, 24 + 9.5], [48 + 13.5, 72 + 15.5]],
        [[2, 4], [6, 8]],
        filled(MAPS, {7: 1, 8: 1, 33: 2, 34: 2, 61: 3, 62: 3, 87: 4, 88: 4}),
    ),
    # rounded first
    (
        psroi(group=1, scale=0.5),
        LINE,
        [0, 1.5, 0, 5.4, 0],
        [[1.5]],
        [[2]],
        [[[[0, 1, 1, 0, 0, 0]]]],
    ),
    # three columns in two bins share the middle one
    (
        psroi(),
        THREE,
        [0, 0, 0, 2, 0],
        [[1.5, 4], [1.5, 4]],
        [[2, 0], [0, 0]],
        filled(THREE, {0: 1, 1: 1}),
    ),
    (psroi(), MAPS + 1, [0, 90, 90, 99, 99], [[0, 0], [0, 0]], [[1, 1], [1, 1]], filled(MAPS)),
    # bins of 0.05
    (psroi(), MAPS, [0, 3, 2, 1, 0], [[15, 39], [63, 87]], [[0, 0], [0, 0]], filled(MAPS)),
]


@pytest.mark.parametrize(("layer", "x", "region", "y", "dy", "dx"), BY_HAND)
def test_by_hand(by_hand, layer, x, region, y, dy, dx):
    by_hand(layer, [x, [region]], [[[y]]], [[[dy]]], [dx, np.zeros((1, 5))])


def test_the_channels_of_the_top_follow_each_other(by_hand):
    """Channel k of the top reads the maps from k G G on, which differ from bin to bin."""
    maps = np.arange(8.0).reshape(1, 8, 1, 1)
    by_hand(psroi(2), [maps, np.zeros((1, 5))], [maps.reshape(1, 2, 2, 2)])


def test_each_region_names_its_item(by_hand, rng):
    """Regions may refer to items in any order, and there may be none."""
    x = rng.normal(size=(3, 2, 4, 4))
    regions = [[item, 0, 0, 3, 3] for item in (2, 0, 2)]
    by_hand(roi(1, 1), [x, regions], [x[[2, 0, 2]].max(axis=(2, 3), keepdims=True)])
    by_hand(roi(1, 1), [x, np.zeros((0, 5))], [np.zeros((0, 2, 1, 1))])


def roi_bin(first, last, k, bins):
    """The pixels of bin k along one axis, at a scale of 1/4."""
    begin, end = (int(math.copysign(math.floor(abs(v) / 4 + 0.5), v)) for v in (first, last))
    length = max(end - begin + 1, 1)
    low, high = k * length // bins, -(-(k + 1) * length // bins)
    return slice(max(begin + low, 0), max(begin + high, 0))


def psroi_bin(first, last, k, bins):
    begin = first / 4
    length = max((last + 1) / 4 - begin, 0.1) / bins
    low, high = begin + k * length + 1e-6, begin + (k + 1) * length - 1e-6
    return slice(max(math.floor(low), 0), max(math.ceil(high), 0))


@pytest.mark.parametrize("kind", ["ROIPooling", "PSROIPooling"])
def test_any_region_gives_what_plain_loops_give(run, rng, kind):
    """Also regions that are outside the maps or have exchanged corners."""
    is_max, G = kind == "ROIPooling", 3
    x = rng.normal(size=(2, 2 if is_max else 2 * G * G, 7, 9))
    items = rng.integers(0, 2, 40)
    corners = rng.uniform(-8, 40, (40, 4))
    rois = np.column_stack([items, corners if is_max else np.rint(corners)])
    layer, bin_, reduced = (
        (roi(3, 4, 0.25), roi_bin, np.max) if is_max else (psroi(2, G, 0.25), psroi_bin, np.mean)
    )
    kind, _, options = layer.partition(" ")
    y = run(f'type: "{kind}" {options}', x, rois).y
    for r, k, i, j in np.ndindex(y.shape):
        item, left, top, right, bottom = rois[r]
        rows, columns = bin_(top, bottom, i, y.shape[2]), bin_(left, right, j, y.shape[3])
        channel = k if is_max else (k * G + i) * G + j
        window = x[int(item), channel, rows, columns]
        assert y[r, k, i, j] == pytest.approx(reduced(window) if window.size else 0, abs=1e-6)
