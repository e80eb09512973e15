"""PriorBox: order, sizes, centres and variances of the boxes."""

import math

import numpy as np
import pytest


def boxes(run, options, map_size=(1, 1), image=(10, 20), **more):
    """Return the boxes (positions and boxes at each, 4), in pixels of the image."""
    done = run(
        f'type: "PriorBox" prior_box_param {{ {options} }}',
        np.zeros((2, 3, *map_size)),
        np.zeros((2, 1, *image)),
        **more,
    )
    assert done.y.shape[:2] == (1, 2)
    return done.y[0, 0].reshape(-1, 4) * np.tile(image[::-1], 2)


def sizes(boxes):
    """Return width and height of boxes."""
    return (boxes[:, 2:] - boxes[:, :2]).round(6)


def centres(boxes):
    return (boxes[:, :2] + boxes[:, 2:]) / 2


MANY = "min_size: 4 min_size: 6 max_size: 9 max_size: 24 aspect_ratio: 4 aspect_ratio: 2.25"
AGAIN = "min_size: 4 aspect_ratio: 1 aspect_ratio: 4 aspect_ratio: 4.0000001 aspect_ratio: 0.25"


@pytest.mark.parametrize(
    ("options", "map_size", "image", "what", "expected"),
    [
        ("min_size: 4", (1, 2), (10, 20), np.array, [[3, 3, 7, 7], [13, 3, 17, 7]]),
        # centres are spread over the image, row by row
        (
            "min_size: 2",
            (2, 3),
            (12, 30),
            centres,
            [[5, 3], [15, 3], [25, 3], [5, 9], [15, 9], [25, 9]],
        ),
        # with a step they are at (position + offset) step, whatever the image
        (
            "min_size: 2 step: 8 offset: 0.25",
            (2, 2),
            (12, 30),
            centres,
            [[2, 2], [10, 2], [2, 10], [10, 10]],
        ),
        (
            "min_size: 2 step_h: 8 step_w: 4 offset: 0",
            (2, 2),
            (10, 20),
            centres,
            [[0, 0], [4, 0], [0, 8], [4, 8]],
        ),
        # for each min_size: its square, that of the mean with max_size, then each ratio
        # and its inverse
        (
            MANY,
            (1, 1),
            (10, 20),
            sizes,
            [
                [4, 4],
                [6, 6],
                [8, 2],
                [2, 8],
                [6, 4 / 1.5],
                [4 / 1.5, 6],
                [6, 6],
                [12, 12],
                [12, 3],
                [3, 12],
                [9, 4],
                [4, 9],
            ],
        ),
        # 1 and every ratio within 1e-6 of an earlier one, or of its inverse, are skipped
        *(
            (f"{AGAIN} {flip}", (1, 1), (10, 20), sizes, [[4, 4], [8, 2], [2, 8]])
            for flip in ("", "flip: false")
        ),
        ("min_size: 4 aspect_ratio: 4 flip: false", (1, 1), (10, 20), sizes, [[4, 4], [8, 2]]),
        (
            "min_size: 2.5 max_size: 3.5",
            (1, 1),
            (10, 20),
            sizes,
            [[2.5] * 2, [math.sqrt(8.75)] * 2],
        ),
        ("min_size: 14", (1, 1), (10, 20), np.array, [[3, -2, 17, 12]]),
        ("min_size: 14 clip: true", (1, 1), (10, 20), np.array, [[3, 0, 17, 10]]),
    ],
)
def test_by_hand(run, options, map_size, image, what, expected):
    np.testing.assert_allclose(what(boxes(run, options, map_size, image)), expected, atol=1e-6)


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
