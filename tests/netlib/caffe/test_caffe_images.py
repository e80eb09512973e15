"""netlib/caffe/images.py: inputs of a net with the arguments and the values of cv2.dnn.blobFromImage."""

from __future__ import annotations

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from netlib import caffe
from netlib.caffe.images import blob_from_image, blob_from_images
from tests.support.nets import inputs

IMAGE = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)  # (H, W, 3)


sides = st.integers(1, 60)


@given(
    data=st.data(),
    channels=st.sampled_from([None, 1, 3, 4]),
    dtype=st.sampled_from([np.uint8, np.float32]),
    size=st.none() | st.tuples(sides, sides),
    scale=st.sampled_from([1.0, 1 / 255, 0.017, 2.3, -1.5]),
    swap=st.booleans(),
    crop=st.booleans(),
)
def test_equal_to_opencv(data, channels, dtype, size, scale, swap, crop) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 1000)))
    shapes = data.draw(st.lists(st.tuples(sides, sides), min_size=1, max_size=3))
    images = [(rng.random((*shape, *([channels] if channels else []))) * 255).astype(dtype) for shape in shapes]
    mean = data.draw(st.sampled_from([(), (104, 117, 123, 9), tuple(rng.uniform(0, 255, channels or 1).tolist())]))
    expected = cv2.dnn.blobFromImages(images, scale, size or (0, 0), mean or (0, 0, 0, 0), swap, crop)
    assert np.array_equal(blob_from_images(images, scale, size, mean, swap, crop), expected)


def test_one_image_equals_opencv() -> None:
    """The positions of the arguments are those of OpenCV."""
    arguments = (1 / 127.5, (5, 4), (127.5, 120, 110), True, True)
    assert np.array_equal(blob_from_image(IMAGE, *arguments), cv2.dnn.blobFromImage(IMAGE, *arguments))
    assert np.array_equal(blob_from_image(IMAGE, size=(0, 0)), cv2.dnn.blobFromImage(IMAGE))


def test_as_an_input(net_of) -> None:
    """A net takes the result as input, also several images at a time; the names are also in netlib.caffe."""
    net = net_of(inputs(data=(1, 3, 4, 4)) + 'layer { name: "p" type: "Power" bottom: "data" top: "y" }')
    blob = caffe.blob_from_images([IMAGE, IMAGE[::-1]], 1.0, (4, 4))
    assert np.array_equal(net.forward(data=blob)["y"], blob)
    assert caffe.blob_from_image is blob_from_image
