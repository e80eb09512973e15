"""transform_param: scale, mean, crop, mirror."""

import numpy as np
import pytest

import netlib
from layers.data.image_data import ImageData
from layers.data.transform import Transformer, warn_of_misplaced
from netlib.layer import Layer
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter
from tests.support.bad_input import bad_inputs
from tests.support.caffe_messages import write_blob


def transformer(options, phase="TRAIN", source="<test>", dtype=np.float64):
    """Return a transformer with these options."""
    text = f'name: "it" type: "ImageData" transform_param {{ {options} }}'
    spec = schema.read(prototxt.parse(text, str(source)), LayerParameter)
    return Transformer(Layer(spec, phase, np.random.default_rng(0), dtype))


def transformed(made, image):
    y = np.full(made.shape(image, "x"), np.nan, made.layer.dtype)
    made.transform(image, y, "x")
    return y


def by_loops(image, mean, scale, top, left, size, mirror):
    """Compute the transformation with loops, as Caffe does."""
    channels = len(image)
    y = np.empty((channels, size, size))
    for c in range(channels):
        for h in range(size):
            for w in range(size):
                value = float(image[c, top + h, left + w]) - mean[c, top + h, left + w]
                y[c, h, size - 1 - w if mirror else w] = value * scale
    return y


@pytest.fixture
def image(rng):
    """An image with three channels of random bytes."""
    return rng.integers(0, 256, (3, 5, 7)).astype(np.uint8)


def test_without_options_only_the_type_changes(image):
    assert np.array_equal(transformed(transformer(""), image), image)


def test_scale_comes_after_the_mean(image):
    """The mean is subtracted before scaling, with one mean for all channels or one per channel."""
    y = transformed(transformer("scale: 0.5 mean_value: 10"), image)
    assert np.array_equal(y, (image - 10.0) * 0.5)
    y = transformed(transformer("scale: 2 mean_value: 1 mean_value: 2 mean_value: 3"), image)
    assert np.array_equal(y, (image - np.array([1.0, 2, 3])[:, None, None]) * 2)


@pytest.mark.parametrize("phase", ["TRAIN", "TEST"])
@pytest.mark.parametrize("mirror", [False, True])
def test_crop_mirror_and_mean_image_together(tmp_path, image, rng, phase, mirror):
    mean = rng.normal(size=image.shape).astype(np.float32)
    write_blob(tmp_path / "mean.binaryproto", mean[None])
    options = (
        f'crop_size: 3 scale: 0.25 mean_file: "mean.binaryproto" mirror: {str(mirror).lower()}'
    )
    # the mean file is in the same folder
    made = transformer(options, phase, source=tmp_path / "net.prototxt")
    possible = {
        (top, left, flip): by_loops(image, mean, 0.25, top, left, 3, flip)
        for top in range(3)
        for left in range(5)
        for flip in (False, True)
    }
    keys, wants = list(possible), np.stack(list(possible.values()))
    found = {}
    for _ in range(600):
        (at,) = np.flatnonzero(np.isclose(transformed(made, image), wants).all(axis=(1, 2, 3)))
        found[keys[at]] = found.get(keys[at], 0) + 1
    places = {(1, 2)} if phase == "TEST" else {(top, left) for top in range(3) for left in range(5)}
    flips = {False, True} if mirror else {False}  # in both phases, as in Caffe
    assert set(found) == {(*place, flip) for place in places for flip in flips}
    assert min(found.values()) > 0.4 * 600 / len(found), "all equally often"


@pytest.mark.parametrize(("size", "top", "left"), [(2, 1, 2), (4, 0, 1), (5, 0, 1)])
def test_the_middle_is_rounded_to_the_top_and_left(image, size, top, left):
    y = transformed(transformer(f"crop_size: {size}", "TEST"), image)
    assert np.array_equal(y, image[:, top : top + size, left : left + size])


def test_float32_is_computed_in_float32(image):
    y = transformed(transformer("scale: 0.1 mean_value: 104.3", dtype=np.float32), image)
    assert y.dtype == np.float32
    assert np.array_equal(y, (image.astype(np.float32) - np.float32(104.3)) * np.float32(0.1))


@bad_inputs(
    netlib.LayerError,
    {
        "crop_size: 6": "...:1:48: error: layer 'it': x: the image (C, H, W) (3, 5, 7) is smaller than crop_size 6",
        "mean_value: 1 mean_value: 2": (
            "...:1:48: error: layer 'it': x: 3 channels, but 2 mean_value; expected one for all, "
            "or one per channel"
        ),
        'mean_file: "m"': (
            "...:1:48: error: layer 'it': x: the image (C, H, W) is (3, 5, 7), mean_file 'm' (3, "
            "5, 6); ..."
        ),
        'mean_file: "m" mean_value: 1': "...:1:63: error: layer 'it': mean_file and mean_value cannot both be given",
        'mean_file: "flat"': "...:1:48: error: layer 'it': mean_file 'flat' has shape (3,), expected (1, C, H, W)",
        "force_color: true force_gray: true": (
            "...:1:66: error: layer 'it': force_color and force_gray cannot both be set"
        ),
        "no mean": (
            'mean_file: "none"',
            netlib.DataError,
            "none: cannot read the blob: No such file or directory",
        ),
        "unknown": (
            "crop: 3",
            netlib.PrototxtError,
            "...:1:48: error: unknown field 'crop' (did you mean 'crop_size'?)",
        ),
    },
)
def test_mistakes(tmp_path, image, given, rejected):
    write_blob(tmp_path / "m", np.zeros((1, 3, 5, 6)))
    write_blob(tmp_path / "flat", np.zeros(3))
    with rejected:
        transformed(transformer(given, source=tmp_path / "net.prototxt"), image)


@bad_inputs(
    netlib.LayerError,
    {
        f"{options} {first}": (
            (options, first),
            f"<test>:1:...: error: layer 'it': x: the image (C, H, W) (3, 5, 7) gives "
            f"{found}, the first of its batch {first}; expected the same number of channels, and ...",
        )
        for options, first, found in (
            ("", (3, 5, 8), (3, 5, 7)),
            ("crop_size: 2", (1, 2, 2), (3, 2, 2)),
        )
    },
)
def test_an_image_that_does_not_fit_its_batch(image, given, rejected):
    """Without crop_size all images of a batch must have the same size; the number of channels
    must always agree.
    """
    with rejected:
        transformer(given[0]).transform(image, np.zeros(given[1]), "x")


def test_options_in_their_old_place_are_pointed_out(caplog, rng):
    """Transformation options in the layer's own block are a warning; Caffe ignores
    them silently.
    """
    text = 'name: "it" type: "ImageData" image_data_param { source: "s" scale: 2 mirror: false }'
    spec = schema.read(prototxt.parse(text, "net"), LayerParameter)
    warn_of_misplaced(ImageData(spec, "TRAIN", rng, np.float32), "scale", "mean_file", "mirror")
    assert [record.message for record in caplog.records] == [
        f"net:1:{column}: layer 'it': ImageData ignores {name} in image_data_param, as Caffe does; "
        "write it in transform_param"
        for name, column in (
            ("scale", text.index("scale") + 1),
            ("mirror", text.index("mirror") + 1),
        )
    ]
