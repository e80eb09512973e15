"""caffe.Classifier: one prediction for each image."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import netlib.caffe as caffe
from netlib.caffe.io import ShapeError
from netlib.errors import NetlibError
from netlib.proto import prototxt
from tests.support.bad_input import bad_inputs

MEANS = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 4 dim: 3 dim: 2 dim: 2 } } }
layer { name: "means" type: "Convolution" bottom: "data" top: "means"
        convolution_param { num_output: 3 kernel_size: 2 group: 3 weight_filler { type: "constant" value: 0.25 } } }
"""  # its output is the mean of each channel
RED_MEAN = 7.5  # of image(4, 4), and of its centre, (5 + 6 + 9 + 10) / 4


@pytest.fixture
def classifier_of(here):
    """``classifier_of(**options)``: a Classifier that predicts the mean of each channel."""

    def make(net=MEANS, **options):
        Path("net.prototxt").write_text(net)
        caffe.Net(prototxt.parse(net), caffe.TEST).save("net.caffemodel")
        return caffe.Classifier("net.prototxt", "net.caffemodel", **options)

    return make


def image(height, width):
    """An image whose red channel numbers the pixels; green is 100, blue is 0."""
    red = np.arange(height * width, dtype=np.float32).reshape(height, width)
    return np.dstack([red, np.full_like(red, 100), np.zeros_like(red)])


def test_without_oversampling_the_centre_is_classified(classifier_of):
    classifier = classifier_of(image_dims=(4, 4))
    found = classifier.predict([image(4, 4)] * 5, oversample=False)
    assert found.shape == (5, 3, 1, 1)
    assert found.dtype == np.float32
    assert_allclose(found[4, :, 0, 0], [RED_MEAN, 100, 0])


def test_predictions_of_ten_crops_are_averaged(classifier_of):
    classifier = classifier_of(image_dims=[4, 4])
    found = classifier.predict([image(4, 4), 2 * image(4, 4)])
    assert_allclose(found, [[RED_MEAN, 100, 0], [2 * RED_MEAN, 200, 0]], rtol=1e-6)


def test_a_classifier_is_a_net(classifier_of):
    classifier = classifier_of()
    assert isinstance(classifier, caffe.Net)
    assert classifier.phase == caffe.TEST
    assert classifier.outputs == ["means"]


def test_the_whole_image_is_the_default(classifier_of):
    """It is resized to the net's input."""
    classifier = classifier_of()
    assert tuple(classifier.image_dims) == tuple(classifier.crop_dims) == (2, 2)
    found = classifier.predict([image(4, 4)], oversample=False)
    assert_allclose(found[0, :, 0, 0], [RED_MEAN, 100, 0], rtol=1e-6)


def test_preprocessing_swaps_scales_and_subtracts(classifier_of):
    """Channels are swapped and multiplied by raw_scale, then the mean is subtracted, and the
    difference is multiplied by input_scale.
    """
    classifier = classifier_of(
        mean=np.array([1.0, 2, 3]), raw_scale=10, input_scale=0.5, channel_swap=(2, 1, 0)
    )
    found = classifier.predict([image(2, 2)], oversample=False)
    assert_allclose(found[0, :, 0, 0], [(0 - 1) / 2, (1000 - 2) / 2, (15 - 3) / 2])
    assert list(classifier.transformer.transpose["data"]) == [2, 0, 1]


TRAINING = """
name: "own" layer { name: "x" type: "DummyData" top: "x" dummy_data_param { shape { dim: 1 dim: 1 } } }
layer { name: "means" type: "InnerProduct" bottom: "x" top: "y" inner_product_param { num_output: 1 } }
"""


def test_a_net_without_an_input_is_rejected(classifier_of):
    message = "^net 'own' has no input for images; expected a deployment net with an Input layer$"
    with pytest.raises(NetlibError, match=message):
        classifier_of(net=TRAINING)


def test_images_smaller_than_the_input_are_rejected(classifier_of):
    message = r"^image_dims \(1, 4\) are smaller than the net's input, \(2, 2\); expected a height and a width$"
    with pytest.raises(ShapeError, match=message):
        classifier_of(image_dims=(1, 4))


@bad_inputs(
    ShapeError,
    {
        "no image": ([], "predict takes images (H, W, K) with the same K, found []"),
        "mixed channels": (
            [image(4, 4), image(4, 4)[..., :1]],
            "predict takes images (H, W, K) with the same K, found [(4, 4, 3), (4, 4, 1)]",
        ),
    },
)
def test_invalid_images_are_rejected(classifier_of, given, rejected):
    classifier = classifier_of()
    with rejected:
        classifier.predict(given)


def test_a_detector_is_not_supported() -> None:
    with pytest.raises(NotImplementedError, match="Classifier"):
        caffe.Detector("deploy.prototxt", "net.caffemodel", context_pad=16)
