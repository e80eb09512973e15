"""DetectionOutput: decoding, non-maximum suppression, selection and order; compared
with plain loops.
"""

import logging
import math

import numpy as np
import pytest

import netlib

WIDE = [0, 0, 1, 1]  # a prior


def text(classes=2, more=""):
    return f'type: "DetectionOutput" detection_output_param {{ num_classes: {classes} {more} }}'


def bottoms(boxes, scores):
    """Return bottoms for one item whose boxes are the priors themselves; scores are per box,
    then per class.
    """
    priors = np.array([boxes, np.full(np.shape(boxes), 0.1)]).reshape(1, 2, -1)
    return np.zeros((1, np.size(boxes))), np.reshape(scores, (1, -1)), priors


def rows(run, options, *arrays, **more):
    y = run(options, *arrays, **more).y
    assert y.shape[:2] == (1, 1)
    assert y.shape[3] == 7
    return y[0, 0]


@pytest.mark.parametrize(
    ("code", "location", "box"),
    [
        ("CORNER", [1, 2, -1, 3], [0.3, 0.8, 0.3, 2.0]),  # corner + variance x location
        (
            "CORNER_SIZE",
            [1, 2, -1, 3],
            [0.24, 0.56, 0.48, 1.28],
        ),  # corner + variance x location x 0.4
        # at (0.44, 0.76)
        ("CENTER_SIZE", [1, 2, math.log(2) / 0.3, math.log(3) / 0.4], [0.04, 0.16, 0.84, 1.36]),
    ],
)
def test_decoding_by_hand(run, code, location, box):
    """A prior of 0.4 x 0.4 at (0.2, 0.4) with variances 0.1 to 0.4, by hand for each code type."""
    priors = np.array([[0.2, 0.4, 0.6, 0.8], [0.1, 0.2, 0.3, 0.4]]).reshape(1, 2, 4)
    found = rows(run, text(more=f"code_type: {code}"), [location], [[0.1, 0.9]], priors)
    assert np.allclose(found, [[0, 1, 0.9, *box]])
    scaled = np.array(location) * [0.1, 0.2, 0.3, 0.4]
    encoded = rows(
        run,
        text(more=f"code_type: {code} variance_encoded_in_target: true"),
        [scaled],
        [[0, 0.9]],
        priors,
    )
    assert np.allclose(encoded, found)
    clipped = rows(
        run, text(more=f"code_type: {code} clip: true"), [location], [[0.1, 0.9]], priors
    )
    assert np.allclose(clipped[0, 3:], np.clip(box, 0, 1))


def test_a_location_for_each_class(run):
    """Without share_location class c of a prior has its own four numbers."""
    locations = [[9] * 4 + [1, 0, 0, 0] + [0, 2, 0, 0]]
    priors = bottoms([WIDE], [0])[2]
    found = rows(run, text(3, "share_location: false"), locations, [[0.2, 0.4, 0.6]], priors)
    assert np.allclose(found, [[0, 1, 0.4, 0.1, 0, 1, 1], [0, 2, 0.6, 0, 0.2, 1, 1]])


def strips(*starts):
    """Return boxes of width 4 and height 1; two that are shifted by s overlap by
    (4 - s) / (4 + s).
    """
    return [[x, 0, x + 4, 1] for x in starts]


NMS = "nms_param { nms_threshold: %s }"
OVERLAPPING = (0, 1, 2), [0.9, 0.8, 0.7]  # overlaps 3/5, 1/3 and 3/5
PAIRS = (0, 1, 20, 21.6, 40, 41.8), [1 - i / 10 for i in range(6)]  # overlaps 0.6, 0.43 and 0.38
APART = (0, 10, 20), [0.5, 0.51, -3]
ALIKE = (0, 10, 20, 30), [0.5, 0.5, 0.7, 0.5]


@pytest.mark.parametrize(
    ("options", "boxes", "kept"),
    [
        (NMS % 0.5, OVERLAPPING, [0, 2]),
        (NMS % 0.65, OVERLAPPING, [0, 1, 2]),
        (NMS % 0.3, OVERLAPPING, [0]),
        # the default is 0.3; dropped boxes suppress none
        ("", OVERLAPPING, [0]),
        (NMS % 0, OVERLAPPING, [0]),
        (NMS % 0, ((0, 4), [1, 1]), [0, 4]),  # touching boxes do not overlap
        # 0.8 is multiplied by 0.5 after the first kept box, but not again, as it is then below 0.5
        ("nms_param { nms_threshold: 0.8 eta: 0.5 }", PAIRS, [0, 20, 40, 41.8]),
        (NMS % 0.8, PAIRS, list(PAIRS[0])),
        # only confidences above the threshold count; without one all do, also negative ones
        ("confidence_threshold: 0.5", APART, [10]),
        ("", APART, [10, 0, 20]),
        # equal confidences keep the sequence of the priors, also where top_k and keep_top_k cut
        ("", ALIKE, [20, 0, 10, 30]),
        ("nms_param { top_k: 3 }", ALIKE, [20, 0, 10]),
        ("keep_top_k: 3", ALIKE, [20, 0, 10]),
    ],
)
def test_selection(run, options, boxes, kept):
    starts, scores = boxes
    arrays = bottoms(strips(*starts), [[0, score] for score in scores])
    assert rows(run, text(more=options), *arrays)[:, 3].tolist() == kept


def test_an_overlap_equal_to_the_threshold_is_kept(run):
    """Boxes with overlap 1/3 are both kept with the threshold 1/3 of the same rounding."""
    arrays = bottoms(strips(0, 2), [[0, 0.9], [0, 0.8]])
    third = float(np.float32(1 / 3))
    assert len(rows(run, text(more=NMS % repr(third)), *arrays, dtype=np.float32)) == 2


FOUR = strips(0, 1, 20, 30), [0, 0.9, 0.1, 0, 0.8, 0.2, 0, 0.7, 0.3, 0, 0.6, 0.95]
ONE = [WIDE], [[0.3, 0.4, 0.5]]


@pytest.mark.parametrize(
    ("options", "boxes", "found"),
    [  # label and xmin of each row
        # candidates per class before the suppression
        ("nms_param { top_k: 2 }", FOUR, [[1, 0], [2, 30], [2, 20]]),
        ("keep_top_k: 3", FOUR, [[1, 0], [1, 20], [2, 30]]),  # detections per item
        ("keep_top_k: 6", FOUR, [[1, 0], [1, 20], [1, 30], [2, 30], [2, 20], [2, 1]]),
        ("keep_top_k: 0", FOUR, [[-1, -1]]),
        ("nms_param { top_k: 0 }", FOUR, [[-1, -1]]),
        ("", ONE, [[1, 0], [2, 0]]),
        ("background_label_id: 1", ONE, [[0, 0], [2, 0]]),
        ("background_label_id: -1", ONE, [[0, 0], [1, 0], [2, 0]]),
    ],
)
def test_classes(run, options, boxes, found):
    assert rows(run, text(3, options), *bottoms(*boxes))[:, [1, 3]].tolist() == found


def test_a_batch_without_detections_has_one_row_per_item(run):
    """In a batch with detections, an item without any has no row."""
    priors = bottoms([WIDE], [[0, 0]])[2]
    options, locations = text(more="confidence_threshold: 0.5"), np.zeros((3, 4))
    found = rows(run, options, locations, np.zeros((3, 2)), priors)
    assert found.tolist() == [[item] + [-1] * 6 for item in range(3)]
    found = rows(run, options, locations, [[0, 0], [0, 1], [0, 0]], priors)
    assert found[:, 0].tolist() == [1]
    assert rows(run, options, np.zeros((0, 4)), np.zeros((0, 2)), priors).shape == (0, 7)


def test_a_confidence_of_nan_is_no_detection(run):
    """Boxes that overflow are infinite."""
    priors = bottoms([WIDE, WIDE], [[0, 0]])[2]
    locations, scores = [[0, 0, 1e5, 1e5, 0, 0, 0, 0]], [[0, 0.5, 0, np.nan]]
    found = rows(run, text(more="code_type: CENTER_SIZE"), locations, scores, priors)
    assert found.tolist() == [[0, 1, 0.5, -np.inf, -np.inf, np.inf, np.inf]]


def test_many_candidates_are_suppressed_in_blocks(run, rng):
    """Boxes that are kept overlap by at most 0.3, and each other one overlaps a kept one of a
    higher confidence.
    """
    corner = rng.uniform(0, 0.9, (700, 2))
    boxes = np.hstack([corner, corner + rng.uniform(0.05, 0.3, (700, 2))])
    scores = rng.uniform(size=(700, 2))
    found = rows(run, text(), *bottoms(boxes, scores))
    low = np.maximum(boxes[:, None, :2], found[None, :, 3:5])
    high = np.minimum(boxes[:, None, 2:], found[None, :, 5:])
    common = (high - low).clip(0).prod(axis=2)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    kept_area = (found[:, 5:] - found[:, 3:5]).prod(axis=1)
    overlaps = common / (area[:, None] + kept_area - common) > 0.3
    better = found[:, 2] > scores[:, 1:]
    is_kept = np.isin(scores[:, 1], found[:, 2])
    assert np.array_equal((overlaps & better).any(axis=1), ~is_kept)
    assert (np.diff(found[:, 2]) < 0).all()
    assert 64 < len(found) < 600


NET = """
input: "x" input_shape { dim: 2 dim: 8 } input: "s" input_shape { dim: 2 dim: 4 }
input: "p" input_shape { dim: 1 dim: 2 dim: 8 }
layer { name: "d" type: "DetectionOutput" bottom: "x" bottom: "s" bottom: "p" top: "d"
        detection_output_param { num_classes: 2 %s } }
layer { name: "scaled" type: "Power" bottom: "d" top: "scaled" power_param { scale: 2 } }
"""


def test_the_number_of_rows_may_change_in_every_pass(net_of):
    """Layers after it receive the rows that were found, and the caller a top of their number."""
    net = net_of(NET % "confidence_threshold: 0.5", netlib.TEST, dtype=np.float64)
    _, _, p = bottoms(strips(0, 10), [0])
    assert net.blobs["d"].shape == (1, 1, 1, 7)
    # without any detection each of the two items has a row
    for first, second, count in (
        ([0, 0.9, 0, 0.8], [0, 0.7, 0, 0], 3),
        ([0] * 4, [0] * 4, 2),
        ([0] * 4, [0, 1, 0, 0], 1),
    ):
        y = net.forward(x=np.zeros((2, 8)), s=np.array([first, second]), p=p)["scaled"]
        assert y.shape[2] == count
        assert np.array_equal(y, 2 * net.blobs["d"].data)


def test_a_prior_without_size(run):
    """The default CORNER accepts a prior that no location can scale."""
    arrays = bottoms([WIDE, [0.5, 0, 0.5, 1]], [[0, 1], [0, 1]])
    assert len(rows(run, text(), *arrays)) == 2


def test_saving_is_ignored_with_a_note(run, caplog):
    """Options that write files or show images are accepted; only those that would take
    effect are noted.
    """
    caplog.set_level(logging.WARNING, "netlib")
    arrays = bottoms([WIDE], [[0, 1]])
    harmless = 'save_output_param { label_map_file: "voc.prototxt" resize_param { height: 3 } }'
    run(text(more=harmless), *arrays)
    assert not caplog.messages
    run(text(more='save_output_param { output_directory: "out" }'), *arrays)
    run(text(more="visualize: true visualize_threshold: 0.4"), *arrays)
    assert [message.split("layer ")[1] for message in caplog.messages] == 2 * [
        "'it': does not show or save detections: visualize and save_output_param are ignored"
    ]
