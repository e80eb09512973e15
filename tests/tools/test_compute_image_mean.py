"""tools/compute_image_mean.py: the mean of images, as a file for transform_param and as
printed numbers.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import netlib
from netlib.proto import prototxt
from netlib.proto.binaryproto import read_blob
from tests.support.caffe_messages import content, datum, number, write_database
from tests.support.running import refusal, run_tool
from tests.tools.conftest import mistakes_of


@pytest.fixture
def images(here, rng):
    """Seven images of bytes with shape (3, 4, 5), in the database db."""
    images = rng.integers(0, 256, (7, 3, 4, 5)).astype(np.uint8)
    write_database(here / "db", [datum(image, 0) for image in images])
    return images


@pytest.fixture
def pictures(images, here):
    """The images as p/0.png ... and list.txt."""
    Path("p").mkdir()
    for n, image in enumerate(images):
        cv2.imwrite(f"p/{n}.png", image.transpose(1, 2, 0))
    Path("list.txt").write_text("".join(f"{n}.png {n}\n" for n in range(len(images))))


def test_the_mean(images):
    """The mean is (1, C, H, W) in float32, and the printed numbers are those of Caffe."""
    done = run_tool("compute_image_mean -backend=lmdb db mean.binaryproto")
    mean = read_blob("mean.binaryproto")
    assert mean.shape == (1, 3, 4, 5)
    assert mean.dtype == np.float32
    assert np.allclose(mean[0], images.mean(axis=0), rtol=1e-6)
    lines = done.out.splitlines()
    assert lines[0] == "Number of channels: 3"
    means = images.mean(axis=(0, 2, 3))
    assert lines[1:] == [f"mean_value channel [{c}]: {mean:.6g}" for c, mean in enumerate(means)]
    assert run_tool("compute_image_mean db").out == done.out  # without a file


def test_a_list_has_the_mean_of_the_database_of_its_images(images, pictures):
    """Lists are those of ImageData layers: with and without labels, relative to the working
    directory or the list.
    """
    done = run_tool("compute_image_mean -root_folder=p/ list.txt mean.binaryproto")
    assert done.out == run_tool("compute_image_mean db same.binaryproto").out
    assert np.array_equal(read_blob("mean.binaryproto"), read_blob("same.binaryproto"))


def test_images_of_a_list_are_resized_as_in_an_ImageData_layer(pictures):
    """A net that resizes the images of the list to the same size and subtracts the mean
    has the mean 0.
    """
    run_tool("compute_image_mean -root_folder p/ -resize_width=9 -resize_height=6 list.txt mean")
    net = netlib.Net(
        prototxt.parse("""layer { name: "d" type: "ImageData" top: "x" top: "t"
        image_data_param { source: "list.txt" root_folder: "p/" batch_size: 7 new_width: 9 new_height: 6 }
        transform_param { mean_file: "mean" } }"""),
        netlib.TEST,
    )
    x = net.forward()["x"]
    assert x.shape == (7, 3, 6, 9)
    assert np.abs(x).mean() > 10
    assert np.abs(x.mean(axis=0)).max() < 1e-4


def test_gray(images, pictures):
    expected = np.mean(
        [cv2.imread(f"p/{n}.png", cv2.IMREAD_GRAYSCALE) for n in range(len(images))], axis=0
    )
    run_tool("compute_image_mean --gray -root_folder=p/ list.txt mean.binaryproto")
    assert np.allclose(read_blob("mean.binaryproto"), expected[None, None], rtol=1e-6)


@mistakes_of("compute_image_mean")
def test_mistakes(images, pictures, argv, message):
    shapes = (1, 1, 2), (1, 2, 1)
    write_database(Path("sizes"), [datum(np.zeros(shape, np.uint8), 0) for shape in shapes])
    header = number(1, 1) + number(2, 1) + number(3, 2)
    write_database(Path("bad"), [header + content(4, b"abc")])
    write_database(Path("empty"), [])
    cv2.imwrite("p/6.png", images[0][:, :2].transpose(1, 2, 0))
    Path("missing.txt").write_text("0.png 1\n7.png 2\n")
    assert refusal(f"compute_image_mean {argv}") == message


def test_options_of_lists_do_not_apply_to_databases(images):
    error = run_tool("compute_image_mean -gray db", status=2).err
    assert "apply only to a list of images, and db is a database" in error


def test_a_list_with_a_name_that_no_file_can_have(here):
    (here / "list.txt").write_bytes(b"a\0b.png 0\n")
    argv = ("-resize_height=8", "-resize_width=8", "list.txt", "mean.binaryproto")
    assert refusal("compute_image_mean", *argv).startswith("a\\x00b.png: cannot read the image: ")
