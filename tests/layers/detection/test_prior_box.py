"""PriorBox: order, sizes, centres and variances of the boxes."""

import math

import numpy as np
import pytest


def boxes(run, options, map_size=(1, 1), image=(10, 20), **more):
    """Return the boxes (positions and boxes at each, 4), in pixels of the image."""
    done = run(f'type: "PriorBox" prior_box_param {{ {options} }}', np.zeros((2, 3, *map_size)),
               np.zeros((2, 1, *image)), **more)
    assert done.y.shape[:2] == (1, 2)
    return done.y[0, 0].reshape(-1, 4) * np.tile(image[::-1], 2)


def sizes(boxes):
    """Return width and height of boxes."""
    return (boxes[:, 2:] - boxes[:, :2]).round(6).tolist()


def test_by_hand(run):
    """Two boxes of 4 x 4 in an image of 10 x 20: the centres of two positions are at x = 5 and 15, y = 5."""
    assert np.allclose(boxes(run, "min_size: 4", (1, 2)), [[3, 3, 7, 7], [13, 3, 17, 7]])


def test_positions_are_sorted_by_rows(run):
    """Centres are spread over the image, row by row."""
    found = boxes(run, "min_size: 2", (2, 3), (12, 30))
    centres = (found[:, :2] + found[:, 2:]) / 2
    assert np.allclose(centres, [[5, 3], [15, 3], [25, 3], [5, 9], [15, 9], [25, 9]])


def test_step_and_offset(run):
    """Centres are at (position + offset) step, whatever the image."""
    found = boxes(run, "min_size: 2 step: 8 offset: 0.25", (2, 2), (12, 30))
    assert np.allclose((found[:, :2] + found[:, 2:]) / 2, [[2, 2], [10, 2], [2, 10], [10, 10]])
    found = boxes(run, "min_size: 2 step_h: 8 step_w: 4 offset: 0", (2, 2))
    assert np.allclose((found[:, :2] + found[:, 2:]) / 2, [[0, 0], [4, 0], [0, 8], [4, 8]])


def test_the_order_of_sizes(run):
    """For each min_size: its square, that of the mean with max_size, then each ratio and its inverse."""
    options = "min_size: 4 min_size: 6 max_size: 9 max_size: 24 aspect_ratio: 4 aspect_ratio: 2.25"
    assert sizes(boxes(run, options)) == [
        [4, 4], [6, 6], [8, 2], [2, 8], [6, round(4 / 1.5, 6)], [round(4 / 1.5, 6), 6],
        [6, 6], [12, 12], [12, 3], [3, 12], [9, 4], [4, 9],
    ]


def test_ratios_that_occur_again_are_skipped(run):
    """1 and every ratio within 1e-6 of an earlier one, or of its inverse, are skipped."""
    options = "min_size: 4 aspect_ratio: 1 aspect_ratio: 4 aspect_ratio: 4.0000001 aspect_ratio: 0.25"
    assert sizes(boxes(run, options)) == [[4, 4], [8, 2], [2, 8]]
    assert sizes(boxes(run, options + " flip: false")) == [[4, 4], [8, 2], [2, 8]]
    assert sizes(boxes(run, "min_size: 4 aspect_ratio: 4 flip: false")) == [[4, 4], [8, 2]]


def test_fractions_are_kept(run):
    """Sizes need not be whole numbers."""
    assert np.allclose(sizes(boxes(run, "min_size: 2.5 max_size: 3.5")), [[2.5] * 2, [math.sqrt(8.75)] * 2])


def test_clip(run):
    """Boxes extend beyond the image unless they are clipped."""
    assert np.allclose(boxes(run, "min_size: 14"), [[3, -2, 17, 12]])
    assert np.allclose(boxes(run, "min_size: 14 clip: true"), [[3, 0, 17, 10]])


@pytest.mark.parametrize(
    ("options", "values"),
    [("", [0.1] * 4), ("variance: 0.5", [0.5] * 4), ("variance: [0.1, 0.2, 0.3, 0.4]", [0.1, 0.2, 0.3, 0.4])],
)
def test_variances(run, options, values):
    """The second row repeats four variances for each box; the default is 0.1."""
    done = run(f'type: "PriorBox" prior_box_param {{ min_size: 1 {options} }}', np.zeros((1, 1, 2, 2)),
               np.zeros((1, 1, 9, 9)), dtype=np.float32)
    assert np.array_equal(done.y[0, 1].reshape(4, 4), np.tile(np.float32(values), (4, 1)))


@pytest.mark.parametrize("options", ["img_size: 40", "img_h: 40 img_w: 40"])
def test_the_size_of_the_image_may_be_given(run, options):
    """Then the second bottom has no influence, and need not have four axes."""
    done = run(f'type: "PriorBox" prior_box_param {{ min_size: 10 {options} }}', np.zeros((1, 1, 1, 1)), np.zeros(3))
    assert np.allclose(done.y[0, 0], [0.375, 0.375, 0.625, 0.625])


def test_a_net_is_trained_around_it(net_of):
    """A loss that reads the boxes does not disturb the gradient of the map's layer."""
    net = net_of("""
        input: "x" input_shape { dim: 1 dim: 1 dim: 1 dim: 2 }
        layer { name: "c" type: "Convolution" bottom: "x" top: "c"
                convolution_param { num_output: 1 kernel_size: 1 bias_term: false } }
        layer { name: "p" type: "PriorBox" bottom: "c" bottom: "x" top: "p" prior_box_param { min_size: 1 } }
        layer { name: "a" type: "Reduction" bottom: "p" top: "a" loss_weight: 1 }
        layer { name: "b" type: "Reduction" bottom: "c" top: "b" loss_weight: 1 }""")
    net.forward(x=np.reshape([3.0, 4.0], (1, 1, 1, 2)))
    net.backward()
    assert net.params["c"][0].diff.ravel().tolist() == [7]
