"""caffe.coord_map: maps between the coordinates of two tops, on examples worked by hand."""

import json
from pathlib import Path

import numpy as np
import pytest

from netlib.caffe import layers as L
from netlib.caffe.coord_map import compose, coord_map, coord_map_from_to, crop, inverse
from tests.support.tables import lines_of


@pytest.fixture
def data():
    return L.Input(shape={"dim": [1, 1, 64, 64]})


def numbers(found):
    """Return a map with its arrays as lists."""
    axis, a, b = found
    return axis, np.ravel(a).tolist(), np.ravel(b).tolist()


@pytest.mark.parametrize(
    ("type_name", "options", "axis", "a", "b"), lines_of(Path(__file__).with_name("coord_maps.txt"))
)
def test_one_layer(data, type_name, options, axis, a, b):
    """Point x of the bottom maps to a x + b of the top: strides scale, kernels and pads shift."""
    top = getattr(L, type_name)(data, **json.loads(options))
    assert numbers(coord_map(top.fn)) == tuple(map(json.loads, (axis, a, b)))


def test_compose_and_inverse():
    """3 (2 x + 1) + 5 = 6 x + 8, and composing with the inverse gives the identity."""
    both = compose((1, 3, 5), (1, 2, 1))
    assert both == (1, 6, 8)
    axis, a, b = compose(both, inverse(both))
    assert axis == 1
    assert a == pytest.approx(1)
    assert b == pytest.approx(0)
    assert compose((None, 1, 0), (2, 3, 4)) == compose((2, 3, 4), (None, 1, 0)) == (2, 3, 4)


def test_from_a_net_to_its_input(data):
    pooled = L.Pooling(L.ReLU(L.Convolution(data, kernel_size=3)), kernel_size=4, stride=4)
    up = L.Deconvolution(pooled, kernel_size=8, stride=4)
    assert numbers(coord_map_from_to(up, data)) == (1, [1], [-1])
    assert numbers(coord_map_from_to(data, up)) == (1, [1], [1])
    assert numbers(coord_map_from_to(up, up)) == (None, [1], [0])


def test_between_two_branches(data):
    """Two branches are related through a common ancestor; only the first bottom of a
    Crop is followed.
    """
    left = L.Convolution(data, kernel_size=3)
    right = L.Convolution(data, kernel_size=7)
    assert numbers(coord_map_from_to(right, left)) == (1, [1], [2])
    cut = L.Crop(left, right, axis=2, offset=2)
    assert numbers(coord_map_from_to(cut, right)) == (1, [1], [0])
    assert numbers(coord_map_from_to(L.Eltwise(left, left), data)) == (1, [1], [1])


def test_crop_makes_the_layer(data):
    """Cropping the scores of FCN-32s to the image gives the offset of the original FCN."""
    conv = L.Convolution(data, kernel_size=3, pad=100)
    for _ in range(5):
        conv = L.Pooling(conv, kernel_size=2, stride=2)
    score = L.Convolution(conv, kernel_size=7)
    up = L.Deconvolution(score, convolution_param={"kernel_size": 64, "stride": 32})
    made = crop(up, data)
    assert made.fn.type_name == "Crop"
    assert made.fn.inputs == (up, data)
    assert made.fn.params == {"crop_param": {"axis": 2, "offset": [19]}}
    assert list(made.to_proto().layer[-1].crop_param.offset) == [19]
    assert crop(L.ReLU(data), data).fn.params == {"crop_param": {"axis": 2, "offset": [0]}}
