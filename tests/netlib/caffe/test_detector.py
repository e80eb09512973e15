"""caffe.Detector: windows of images with a border of context. The crops are compared with pycaffe's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import netlib.caffe as caffe
from netlib.caffe.io import ShapeError
from netlib.errors import NetlibError
from netlib.proto import prototxt
from tests.support.bad_input import bad_inputs

MEAN = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 2 dim: %d dim: 6 dim: 6 } } }
layer { name: "mean" type: "Convolution" bottom: "data" top: "mean"
        convolution_param { num_output: 1 kernel_size: 6 weight_filler { type: "constant" value: 0.027777778 } } }
"""  # the mean of all pixels and channels
GRAY = np.arange(64, dtype=np.float32).reshape(8, 8, 1)


@pytest.fixture
def make(tmp_path):
    """``make(channels, **options)``: a Detector that predicts the mean of its input."""

    def made(channels=1, **options):
        (tmp_path / "net.prototxt").write_text(MEAN % channels)
        caffe.Net(prototxt.parse(MEAN % channels), caffe.TEST).save(tmp_path / "net.caffemodel")
        return caffe.Detector(str(tmp_path / "net.prototxt"), str(tmp_path / "net.caffemodel"), **options)

    return made


def test_windows(make, tmp_path):
    """There is one prediction for each window of each image, in order."""
    pixels = np.zeros((10, 12), np.uint8)
    pixels[:6, :6], pixels[4:, 6:] = 51, 255
    cv2.imwrite(str(tmp_path / "a.png"), pixels)
    cv2.imwrite(str(tmp_path / "b.png"), pixels[::-1])
    windows = np.array([[0, 0, 6, 6], [4, 6, 10, 12]])
    found = make(3).detect_windows(zip([str(tmp_path / "a.png"), str(tmp_path / "b.png")], [windows, [[0, 6, 6, 12]]]))
    assert [set(one) for one in found] == [{"window", "prediction", "filename"}] * 3
    assert [one["filename"] for one in found] == [str(tmp_path / name) for name in ("a.png", "a.png", "b.png")]
    assert [list(one["window"]) for one in found] == [[0, 0, 6, 6], [4, 6, 10, 12], [0, 6, 6, 12]]
    predictions = [one["prediction"].item() for one in found]
    np.testing.assert_allclose(predictions, [3 * 0.2, 3, 3], rtol=1e-5)  # three equal channels
    assert make(3).detect_windows([]) == []


def test_the_window_alone(make):
    """Without context a crop is exactly the window, without resizing."""
    assert make().crop(GRAY, [1, 2, 3, 5])[..., 0].tolist() == [[10, 11, 12], [18, 19, 20]]


@pytest.mark.parametrize(
    ("window", "rows"),
    [
        ([2, 2, 5, 5], {0: [9, 10, 11, 12, 13, 14], 5: [49, 50, 51, 52, 53, 54]}),
        ([0, 1, 3, 5], {0: [1.5] * 6, 1: [0.0833, 1.25, 2.4167, 3.5833, 4.75, 5.9167],
                        5: [32.0833, 33.25, 34.4167, 35.5833, 36.75, 37.9167]}),
        ([5, 5, 8, 8], {0: [36, 37, 38, 39, 1.5, 1.5], 4: [1.5] * 6}),
    ],
    ids=["inside", "over the top", "over the corner"],
)
def test_a_border_of_context(make, window, rows):
    """context_pad adds pixels on each side; outside the image the mean is used."""
    detector = make(mean=np.array([3.0]), raw_scale=2.0, context_pad=1)
    found = detector.crop(GRAY, np.array(window))
    assert found.shape == (6, 6, 1)
    for y, row in rows.items():
        np.testing.assert_allclose(found[y, :, 0], row, atol=1e-4)


def test_the_mean_in_the_order_of_an_image(make):
    """The mean of a crop is in the channel order of the image, before the channel swap."""
    mean = np.arange(3.0)[:, None, None] + np.zeros((3, 6, 6))
    detector = make(3, mean=mean, channel_swap=(1, 2, 0), context_pad=2)
    assert detector.crop_mean.shape == (6, 6, 3) and detector.crop_mean[0, 0].tolist() == [2, 0, 1]
    detector.configure_crop(None)
    assert detector.context_pad is None and list(detector.crop_dims) == [6, 6, 3]


def test_without_a_mean_it_is_black(make):
    """Without a mean the border of a crop is zero."""
    assert (make(context_pad=1).crop_mean == np.zeros((6, 6, 1))).all()


OUTSIDE = "the window (20, 20, 25, 25) (ymin, xmin, ymax, xmax) is outside an image of 8 x 8 pixels"


@bad_inputs(ShapeError, {
    "outside": (lambda make: make().crop(GRAY, np.array([20, 20, 25, 25])), OUTSIDE),
    "outside with a border": (lambda make: make(context_pad=1).crop(GRAY, np.array([20, 20, 25, 25])), OUTSIDE),
    **{str(window): (lambda make, window=window: make().crop(GRAY, window),
                     f"a window is (ymin, xmin, ymax, xmax) in pixels, found {window}")
       for window in [(0, 0, 4), (0, 0, 4, "a"), (0, 0, 4, np.nan), 4]},
    "a wide border": (lambda make: make(context_pad=3),
                      "context_pad 3 needs a square input of more than twice as many pixels, 'data' has 6 x 6"),
    "selective search": (lambda make: make().detect_selective_search(["a.png"]), NetlibError,
                         "detect_selective_search needs MATLAB and ..., which are not supported; pass your own ..."),
})
def test_mistakes(make, given, rejected):
    """Windows outside the image, malformed windows, too wide a border and selective search raise an error."""
    with rejected:
        given(make)
