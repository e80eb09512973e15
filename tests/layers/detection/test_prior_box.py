"""PriorBox: order, sizes, centres and variances of the boxes."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.support.tables import lines_of, shape_of


def boxes(run, options, map_size=(1, 1), image=(10, 20), **more):
    """Return the boxes (positions and boxes at each, 4), in pixels of the image."""
    maps, images = np.zeros((2, 3, *map_size)), np.zeros((2, 1, *image))
    done = run(f'type: "PriorBox" prior_box_param {{ {options} }}', maps, images, **more)
    assert done.y.shape[:2] == (1, 2)
    return done.y[0, 0].reshape(-1, 4) * np.tile(image[::-1], 2)


def sizes(boxes):
    """Return width and height of boxes."""
    return (boxes[:, 2:] - boxes[:, :2]).round(6)


def centres(boxes):
    return (boxes[:, :2] + boxes[:, 2:]) / 2


COMPARED = {"boxes": np.array, "centres": centres, "sizes": sizes}


@pytest.mark.parametrize(
    ("options", "shapes", "what", "expected"), lines_of(Path(__file__).with_name("prior_boxes.txt"))
)
def test_by_hand(run, options, shapes, what, expected):
    map_size, image = map(shape_of, shapes.split())
    found = COMPARED[what](boxes(run, options, map_size, image))
    assert_allclose(found, json.loads(expected), atol=1e-6)


@pytest.mark.parametrize(
    ("options", "values"),
    [
        ("", [0.1] * 4),
        ("variance: 0.5", [0.5] * 4),
        ("variance: [0.1, 0.2, 0.3, 0.4]", [0.1, 0.2, 0.3, 0.4]),
    ],
)
def test_variances(run, options, values):
    """The second row repeats four variances for each box; the default is 0.1."""
    done = run(
        f'type: "PriorBox" prior_box_param {{ min_size: 1 {options} }}',
        np.zeros((1, 1, 2, 2)),
        np.zeros((1, 1, 9, 9)),
        dtype=np.float32,
    )
    assert np.array_equal(done.y[0, 1].reshape(4, 4), np.tile(np.float32(values), (4, 1)))


@pytest.mark.parametrize("options", ["img_size: 40", "img_h: 40 img_w: 40"])
def test_the_size_of_the_image_may_be_given(run, options):
    """Then the second bottom has no influence, and need not have four axes."""
    done = run(
        f'type: "PriorBox" prior_box_param {{ min_size: 10 {options} }}',
        np.zeros((1, 1, 1, 1)),
        np.zeros(3),
    )
    assert np.allclose(done.y[0, 0], [0.375, 0.375, 0.625, 0.625])
