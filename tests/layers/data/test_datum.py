"""Datum messages read from bytes."""

import cv2
import numpy as np
import pytest

import netlib
from layers.data.images import decode_datum
from tests.support.bad_input import bad_inputs
from tests.support.caffe_messages import content, datum, number


@pytest.mark.parametrize("label", [0, 7, 300, 2**31 - 1, -1])
def test_bytes_and_a_label(rng, label):
    image = rng.integers(0, 256, (2, 3, 4)).astype(np.uint8)
    values, found = decode_datum(datum(image, label), None, "d")
    assert found == label
    assert np.array_equal(values, image)


def test_floats(rng):
    """Floats are read one by one, as Caffe writes them, or packed."""
    image = rng.normal(size=(2, 3, 4)).astype(np.float32)
    packed = number(1, 2) + number(2, 3) + number(3, 4) + content(6, image.tobytes())
    for data in (datum(image, 1), packed):
        assert np.array_equal(decode_datum(data, None, "d")[0], image)


@pytest.mark.parametrize(("color", "channels"), [(None, 3), (True, 3), (False, 1)])
def test_an_encoded_picture(rng, color, channels):
    """An encoded image is decoded by OpenCV, with channels in the order blue, green,
    red, or to gray.
    """
    image = rng.integers(0, 256, (4, 5, 3)).astype(np.uint8)
    png = cv2.imencode(".png", image)[1].tobytes()
    values, label = decode_datum(datum(png, 3), color, "d")
    assert (values.shape, label) == ((channels, 4, 5), 3)
    grey = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE)[None]
    assert np.array_equal(values, grey if channels == 1 else image.transpose(2, 0, 1))


def test_a_grey_picture_stays_grey_or_becomes_colour(rng):
    png = cv2.imencode(".png", rng.integers(0, 256, (4, 5)).astype(np.uint8))[1].tobytes()
    assert decode_datum(datum(png, 0), None, "d")[0].shape == (1, 4, 5)
    assert decode_datum(datum(png, 0), True, "d")[0].shape == (3, 4, 5)


WHOLE = datum(np.arange(6, dtype=np.uint8).reshape(1, 2, 3), 3)


@bad_inputs(
    netlib.DataError,
    {
        "cut": (
            WHOLE[:-1],
            "d: byte 15: truncated: the message ends within a number; expected a Datum",
        ),
        "no data": (WHOLE[:6], "d: a Datum with channels, height, width (1, 2, 3) has 0 values"),
        "empty": (b"", "d: a Datum with channels, height, width (0, 0, 0) has 0 values"),
        "a number as data": (
            number(4, 5),
            "d: a Datum with channels, height, width (0, 0, 0) has 0 values",
        ),
        "text": (datum(b"text", 0), "d: not an image that OpenCV can decode (4 bytes)"),
        "nothing": (datum(b"", 0), "d: not an image that OpenCV can decode (0 bytes)"),
        "16 bits": (
            datum(cv2.imencode(".png", np.zeros((2, 2), np.uint16))[1].tobytes(), 0),
            "d: image of type uint16, expected 8 bits per value",
        ),
    },
)
def test_mistakes(given, rejected):
    with rejected:
        decode_datum(given, None, "d")
