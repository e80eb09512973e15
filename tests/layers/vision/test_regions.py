"""ROIPooling and PSROIPooling: regions, their items and channels, and bins compared with loops."""

import math

import numpy as np
import pytest


def roi(h=2, w=2, scale=1.0):
    return f"ROIPooling roi_pooling_param {{ pooled_h: {h} pooled_w: {w} spatial_scale: {scale} }}"


def psroi(dim=1, group=2, scale=1.0):
    return f"PSROIPooling psroi_pooling_param {{ spatial_scale: {scale} output_dim: {dim} group_size: {group} }}"


def test_a_bin_is_the_mean_of_its_own_map(by_hand):
    """The four bins of rows 1 to 2 and columns 1 to 4 have one row and two columns each."""
    maps = np.arange(96.0).reshape(1, 4, 4, 6)  # map c of pixel (h, w) has 24 c + 6 h + w
    y = [[7.5, 24 + 9.5], [48 + 13.5, 72 + 15.5]]
    dx = np.zeros(maps.shape)
    dx.flat[[7, 8, 33, 34, 61, 62, 87, 88]] = 1, 1, 2, 2, 3, 3, 4, 4
    layer, regions = psroi(), [[0, 1, 1, 4, 2]]
    by_hand(layer, [maps, regions], [[[y]]], [[[[[2, 4], [6, 8]]]]], [dx, np.zeros((1, 5))])


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
