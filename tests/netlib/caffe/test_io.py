"""caffe.io: messages and arrays, the Transformer, images.

Expected values of resized images are scikit-image's.
"""

import sys
from io import BytesIO
from types import ModuleType

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from netlib.caffe import io
from netlib.caffe.proto import caffe_pb2
from netlib.errors import NetlibError

SMALL = np.array([[0, 10, 20], [40, 30, 60]], np.float32)


def test_blobproto_and_back():
    """Values and gradients keep their shape and are returned in double precision, as in pycaffe."""
    blob = io.array_to_blobproto(np.arange(6).reshape(1, 2, 3), np.full((1, 2, 3), 0.5))
    assert list(blob.shape.dim) == [1, 2, 3]
    data, diff = io.blobproto_to_array(blob), io.blobproto_to_array(blob, return_diff=True)
    assert data.dtype == np.float64
    assert data.tolist() == [[[0, 1, 2], [3, 4, 5]]]
    assert diff.tolist() == [[[0.5] * 3] * 2]


@pytest.mark.parametrize(
    ("blob", "array"),
    [
        # which pycaffe ignores
        (caffe_pb2.BlobProto(double_data=[0.1, 0.2], shape={"dim": [2]}), [0.1, 0.2]),
        (caffe_pb2.BlobProto(data=[7]), 7),
    ],
)
def test_other_blobprotos(blob, array):
    assert io.blobproto_to_array(blob).tolist() == array


def test_blobprotovector():
    arrays = [np.arange(3.0), np.ones((2, 1))]
    found = io.blobprotovector_str_to_arraylist(io.arraylist_to_blobprotovector_str(arrays))
    assert [a.tolist() for a in found] == [[0, 1, 2], [[1], [1]]]


@pytest.mark.parametrize(
    ("dtype", "back"), [(np.uint8, np.uint8), (np.float32, np.float64), (np.int64, np.float64)]
)
def test_datum_and_back(dtype, back):
    """A Datum keeps uint8 values; all other types become float64."""
    array = np.arange(12).reshape(3, 2, 2).astype(dtype)
    datum = io.array_to_datum(array, label=4)
    assert (datum.channels, datum.height, datum.width, datum.label) == (3, 2, 2, 4)
    assert (len(datum.data), len(datum.float_data)) == ((12, 0) if dtype == np.uint8 else (0, 12))
    found = io.datum_to_array(caffe_pb2.Datum.FromString(datum.SerializeToString()))
    assert found.dtype == back
    assert (found == array).all()
    found[0] = 1  # the array is a writable copy
    assert not io.array_to_datum(array).HasField("label")


@pytest.fixture
def transformer() -> io.Transformer:
    made = io.Transformer({"data": (4, 3, 2, 3)})
    made.set_transpose("data", (2, 0, 1))
    return made


def test_preprocess_step_by_step(transformer):
    """The steps are transpose, channel swap, raw scale, mean and input scale; worked by hand
    for one pixel.
    """
    transformer.set_channel_swap("data", (2, 1, 0))
    transformer.set_raw_scale("data", 255)
    transformer.set_mean("data", np.array([100.0, 110, 120]))
    transformer.set_input_scale("data", 0.5)
    image = np.zeros((2, 3, 3))
    image[1, 2] = 0.2, 0.4, 0.6  # red, green, blue
    found = transformer.preprocess("data", image)
    assert found.dtype == np.float32
    assert found.shape == (3, 2, 3)
    assert_allclose(found[:, 1, 2], [(153 - 100) / 2, (102 - 110) / 2, (51 - 120) / 2], rtol=1e-6)
    assert_allclose(found[:, 0, 0], [-50, -55, -60])


def test_preprocess_leaves_the_image_alone(transformer):
    """The image is not modified; pycaffe writes into a float32 image of the input's size."""
    transformer.set_raw_scale("data", 255)
    image = np.ones((2, 3, 3), np.float32)
    transformer.preprocess("data", image)
    assert (image == 1).all()


def test_deprocess_undoes_preprocess(transformer, rng):
    """deprocess reverses every step except resizing, and leaves the blob unchanged."""
    transformer.set_channel_swap("data", (1, 2, 0))
    transformer.set_raw_scale("data", 255)
    transformer.set_mean("data", rng.uniform(0, 255, (3, 2, 3)))
    transformer.set_input_scale("data", 0.01)
    image = rng.uniform(size=(2, 3, 3)).astype(np.float32)
    item = transformer.preprocess("data", image)
    before = item.copy()
    assert_allclose(transformer.deprocess("data", item[None]), image, atol=1e-6)
    assert (item == before).all()


def test_deprocess_of_a_gray_image():
    """Axes of length 1 are dropped, as matplotlib expects; pycaffe fails if a transpose is set."""
    transformer = io.Transformer({"data": (1, 1, 2, 3)})
    transformer.set_transpose("data", (2, 0, 1))
    transformer.set_mean("data", np.array([1], np.uint8))
    assert transformer.deprocess("data", np.zeros((1, 1, 2, 3), np.float32)).tolist() == [
        [1, 1, 1],
        [1, 1, 1],
    ]


@pytest.mark.parametrize(
    ("mean", "kept"),
    [
        (np.arange(3.0), (3, 1, 1)),
        (np.ones((2, 3)), (2, 3)),
        (np.ones((3, 2, 3)), (3, 2, 3)),
        (np.ones((1, 5, 5)), (1, 2, 3)),
        (np.ones((5, 5)), (1, 2, 3)),
    ],
)
def test_means(transformer, mean, kept):
    """A mean is one number per channel, or an image with one channel or with all channels."""
    transformer.set_mean("data", mean)
    assert transformer.mean["data"].shape == kept
    if mean.ndim > 1:
        assert (transformer.mean["data"] == 1).all()


def test_a_mean_of_another_size():
    """A mean image is resized to the input; the values agree with pycaffe and scikit-image."""
    transformer = io.Transformer({"data": (1, 3, 3, 4)})
    transformer.set_mean("data", np.arange(12.0).reshape(3, 2, 2))
    expected = [[0, 0.20833, 0.625, 0.625], [0.75, 1.25, 1.75, 1.5], [1.25, 1.875, 2.29167, 1.875]]
    assert_allclose(transformer.mean["data"][0], expected, atol=1e-5)


def test_a_mean_without_transpose():
    transformer = io.Transformer({"data": (1, 3, 2, 4)})
    transformer.set_mean("data", np.zeros((3, 2, 4)))
    with pytest.raises(ValueError, match=r"shape \(3, 2, 4\), the array \(2, 4, 3\); .*transpose"):
        transformer.preprocess("data", np.zeros((2, 4, 3)))


RESIZED = {
    (3, 4): [
        [0, 5.208333, 11.458333, 14.583334],
        [17.5, 20, 27.5, 35],
        [29.166668, 28.125, 34.375, 43.75],
    ],
    (4, 6): [
        [0, 1.875, 5.625, 9.375, 13.125, 11.25],
        [7.5, 11.25, 13.75, 18.75, 26.25, 22.5],
        [22.5, 28.75, 26.25, 31.25, 43.75, 37.5],
        [22.5, 28.125, 24.375, 28.125, 39.375, 33.75],
    ],
    (1, 2): [[20, 35]],
}


@pytest.mark.parametrize("size", RESIZED)
def test_resized_as_scikit_image_does(size):
    found = io.resize_image(SMALL[..., None], size)
    assert found.dtype == np.float32
    assert_allclose(found[..., 0], RESIZED[size], atol=1e-5)
    in_colour = io.resize_image(np.stack([SMALL] * 3, axis=-1), size)
    assert_allclose(in_colour, np.stack([found[..., 0]] * 3, axis=-1), atol=1e-5)


@pytest.mark.parametrize(
    ("order", "first_row"),
    [(0, [0, 10, 10, 20]), (3, [0, 1.425636, 11.090056, 11.989746])],
    ids=["nearest", "cubic"],
)
def test_other_orders(order, first_row):
    """Order 0 takes the nearest pixel; order 3 uses cubic splines, clipped to the
    range of the image.
    """
    found = io.resize_image(SMALL[..., None], (3, 4), interp_order=order)
    assert_allclose(found[0, :, 0], first_row, atol=1e-5)
    assert found.min() >= 0
    assert found.max() <= 60


def test_resized_integers():
    """The range of an image may be larger than that of its type."""
    image = np.array([[[-100], [100]]], np.int8)
    assert io.resize_image(image, (1, 2)).tolist() == image.tolist()


def test_resized_with_other_channels():
    found = io.resize_image(np.stack([SMALL, SMALL + 1], axis=-1), (3, 4))
    expected = [[0, 6.666667, 13.333333, 20], [20, 20, 26.666666, 40], [40, 33.333332, 40, 60]]
    assert_allclose(found[..., 0], expected, atol=1e-5)
    assert_allclose(found[..., 1], np.array(expected) + 1, atol=1e-5)


def test_ten_crops():
    image = np.arange(20, dtype=np.float32).reshape(4, 5, 1)
    crops = io.oversample([image, image + 100], (2, 2))
    assert crops.shape == (20, 2, 2, 1)
    assert crops.dtype == np.float32
    assert crops[:5, 0, 0, 0].tolist() == [0, 3, 10, 13, 6]
    assert crops[0, ..., 0].tolist() == [[0, 1], [5, 6]]
    assert crops[5, ..., 0].tolist() == [[1, 0], [6, 5]]
    assert (crops[5:10] == crops[:5, :, ::-1]).all()
    assert (crops[10:] == crops[:10] + 100).all()


BGR = np.array([[[0, 51, 255], [255, 255, 255]]], np.uint8)  # one orange pixel, one white pixel
RGB = [[[1, 0.2, 0], [1, 1, 1]]]
LUMA = [[[0.2125 + 0.7154 * 0.2], [1]]]
GRAY = [[[0], [0.2], [1]]]


@pytest.mark.parametrize(
    ("pixels", "colour", "gray"),
    [
        (BGR, RGB, LUMA),
        (np.dstack([BGR, [[0, 128]]]).astype(np.uint8), RGB, LUMA),
        (np.array([[0, 51, 255]], np.uint8), np.repeat(GRAY, 3, axis=2), GRAY),
        (np.array([[0, 13107, 65535]], np.uint16), np.repeat(GRAY, 3, axis=2), GRAY),
        (np.array([[0.25, 5]], np.float32), [[[0.25] * 3, [5] * 3]], [[[0.25], [5]]]),
    ],
    ids=["8 bits", "alpha", "gray", "16 bits", "floats"],
)
def test_images(tmp_path, pixels, colour, gray):
    """Colour is red first in [0, 1], gray has scikit-image's weights, alpha is dropped, and floats
    are not scaled.

    Scripts that receive images, as a web server does, pass open files and BytesIO.
    """
    path = tmp_path / "a.tiff"
    assert cv2.imwrite(str(path), pixels)
    with open(path, "rb") as file:
        for source in (path, file, BytesIO(path.read_bytes())):
            found = io.load_image(source)
            assert found.dtype == np.float32
            assert_allclose(found, colour, rtol=1e-6)
    assert_allclose(io.load_image(str(path), color=False), gray, rtol=1e-6)


def test_names_of_other_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scripts use what pycaffe's module imports: SciPy's zoom; scikit-image, or a line that says
    that it is missing.
    """
    assert io.zoom(np.ones((2, 2)), 2).shape == (4, 4)
    for name in ("skimage", "resize"):
        monkeypatch.setitem(sys.modules, "skimage.transform", None)
        with pytest.raises(
            NetlibError,
            match=f"caffe.io.{name} is of scikit-image, which is missing: pip install scikit-image",
        ):
            getattr(io, name)
    package = ModuleType("skimage")
    transform = ModuleType("skimage.transform")
    transform.resize = package.resize = lambda image, shape: shape  # type: ignore[attr-defined]
    for found in (package, transform, ModuleType("skimage.io")):
        monkeypatch.setitem(sys.modules, found.__name__, found)
    assert io.skimage is package
    assert io.resize(None, (2, 2)) == (2, 2)
    with pytest.raises(AttributeError, match="has no attribute 'rescale'"):
        print(io.rescale)
