"""tools/convert_imageset.py: images in a database, as a Data layer reads them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import netlib
from netlib.proto import prototxt, schema, wire
from netlib.proto.messages import Datum
from tests.support.running import run_tool
from tools import convert_imageset
from tools.common.databases import read_database

NET = """layer {{ name: "d" type: "Data" top: "x" top: "t"
         data_param {{ source: "{0}" batch_size: {1} backend: LMDB }} transform_param {{ {2} }} }}"""


@pytest.fixture
def pictures(tmp_path, monkeypatch, rng):
    """Five PNG images of 6 x 8 pixels in p/, and list.txt with labels 10, 9, 8 ..."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p").mkdir()
    images = rng.integers(0, 256, (5, 6, 8, 3)).astype(np.uint8)
    for i, image in enumerate(images):
        cv2.imwrite(f"p/im {i}.png", image)
    (tmp_path / "list.txt").write_text("".join(f"im {i}.png {10 - i}\n" for i in range(5)))
    return images


def batch(database="db", count=5, transform=""):
    """Return images and labels of the first batch of a net that reads the database."""
    tops = netlib.Net(prototxt.parse(NET.format(database, count, transform)), netlib.TEST).forward()
    return tops["x"], tops["t"].tolist()


def entries(database="db"):
    """Return a dict from key to Datum."""
    _, found = read_database(database)
    return {what.split("'")[1]: schema.read(wire.decode(value, Datum), Datum) for what, value in found}


def test_a_net_reads_the_same_pixels(pictures):
    """Pixels are in OpenCV's order blue, green, red, and keys are those of Caffe."""
    done = run_tool("convert_imageset", "p/", "list.txt", "db")
    x, t = batch()
    assert np.array_equal(x, pictures.transpose(0, 3, 1, 2)) and t == [10, 9, 8, 7, 6]
    assert list(entries()) == [f"0000000{i}_im {i}.png" for i in range(5)]
    assert done[1:] == ("db: 5 entries\n", "")


def test_gray(pictures):
    """-gray gives one channel, as OpenCV reads it."""
    run_tool("convert_imageset", "-gray", "p/", "list.txt", "db")
    wanted = [cv2.imread(f"p/im {i}.png", cv2.IMREAD_GRAYSCALE) for i in range(5)]
    assert np.array_equal(batch()[0][:, 0], wanted)


def test_resize(pictures):
    """Images are resized to any size by linear interpolation."""
    run_tool("convert_imageset", "-resize_height=3", "--resize_width", "12", "p/", "list.txt", "db")
    wanted = [cv2.resize(image, (12, 3)).transpose(2, 0, 1) for image in pictures]
    assert np.array_equal(batch()[0], wanted)


def test_shuffle(pictures):
    """The shuffled order is the same in every run, and keys are numbered in that order."""
    run_tool("convert_imageset", "-shuffle", "p/", "list.txt", "a")
    run_tool("convert_imageset", "--shuffle=true", "p/", "list.txt", "b")
    (x, t), again = batch("a"), batch("b")
    assert np.array_equal(x, again[0]) and t == again[1]
    assert sorted(t) == [6, 7, 8, 9, 10] and t != [10, 9, 8, 7, 6]
    assert [key[:9] for key in entries("a")] == [f"0000000{i}_" for i in range(5)]
    assert np.array_equal(x, pictures[[10 - int(label) for label in t]].transpose(0, 3, 1, 2))


def test_encoded(pictures, tmp_path):
    """-encoded stores the files themselves, which a net decodes to the same pixels."""
    run_tool("convert_imageset", "-encoded", "p/", "list.txt", "db")
    found = list(entries().values())
    assert all(datum.encoded for datum in found)
    assert [datum.data for datum in found] == [(tmp_path / f"p/im {i}.png").read_bytes() for i in range(5)]
    x, t = batch()
    assert np.array_equal(x, pictures.transpose(0, 3, 1, 2)) and t == [10, 9, 8, 7, 6]


@pytest.mark.parametrize(
    ("flags", "magic", "shape"),
    [
        (["-encode_type=jpg"], b"\xff\xd8\xff", (5, 3, 6, 8)),
        (["-encoded", "-encode_type", "png", "-gray"], b"\x89PNG", (5, 1, 6, 8)),
        (["-encoded", "-resize_width=4", "-resize_height=4"], b"\x89PNG", (5, 3, 4, 4)),
    ],
    ids=["another type", "gray", "resized"],
)
def test_encoded_anew(pictures, flags, magic, shape):
    """Images are encoded again if needed; with -gray Caffe would store the colour file."""
    run_tool("convert_imageset", *flags, "p/", "list.txt", "db")
    assert all(datum.data.startswith(magic) for datum in entries().values())
    assert batch()[0].shape == shape


def test_pictures_that_cannot_be_read_are_left_out(pictures, tmp_path):
    """Unreadable images are named and skipped, and the numbers of the others do not change, as in Caffe."""
    (tmp_path / "p/im 1.png").write_text("no picture")
    (tmp_path / "p/im 3.png").unlink()
    done = run_tool("convert_imageset", "p/", "list.txt", "db")
    assert list(entries()) == [f"0000000{i}_im {i}.png" for i in (0, 2, 4)]
    assert done.err.splitlines() == [
        "p/im 1.png: not an image that OpenCV can decode (10 bytes); skipped",
        "p/im 3.png: cannot read the image: No such file or directory; skipped",
        "skipped 2 of 5 images",
    ]


def test_sizes(pictures):
    """Sizes may differ, unless -check_size is given; -resize makes them equal."""
    cv2.imwrite("p/im 3.png", pictures[0][:5])
    run_tool("convert_imageset", "p/", "list.txt", "db")
    assert [datum.height for datum in entries().values()] == [6, 6, 6, 5, 6]
    assert run_tool("convert_imageset", "-check_size", "p/", "list.txt", "checked", status=1).err == (
        "p/im 3.png: the image (H, W, C) is (5, 8, 3), the first (6, 8, 3); expected equal shapes because of "
        "-check_size\n"
    )
    run_tool("convert_imageset", "-check_size", "-resize_width=4", "-resize_height=4", "p/", "list.txt", "checked")


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["p", "list.txt", "db"], "list.txt: none of its 5 images can be read; ROOTFOLDER/ is prepended to every path, "
                                  "as in 'pim 0.png'"),
        (["p/", "none.txt", "db"], "none.txt: cannot read the list of images: No such file or directory"),
        (["p/", "list.txt", "p"], "p: exists already; expected a new name for each database"),
        (["-resize_width=1000000", "-resize_height=1000000", "p/", "list.txt", "db"],
         "images resized to 1000000 x 1000000 pixels; expected at most 268435456"),
        (["-encode_type=tga7", "p/", "list.txt", "db"], "p/im 0.png: OpenCV cannot encode images of type 'tga7'; "
                                                        "expected for example -encode_type png"),
    ],
)
def test_mistakes(pictures, tmp_path, argv, message):
    """Errors are one line with status 1, and no database is written."""
    before = sorted(tmp_path.rglob("*"))
    assert run_tool("convert_imageset", *argv, status=1).err.splitlines()[-1] == message
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["p/", "list.txt"], "the following arguments are required: DB_NAME"),
        (["-backend=leveldb", "p/", "list.txt", "db"], "leveldb is not supported; use lmdb"),
        (["-resize_width=4", "p/", "list.txt", "db"], "-resize_width and -resize_height must be given together"),
        (["-gray=perhaps", "p/", "list.txt", "db"], "ignored explicit argument 'perhaps'"),
    ],
)
def test_wrong_usage(argv, message):
    """Wrong usage gives argparse's message and status 2."""
    assert message in run_tool("convert_imageset", *argv, status=2).err


def test_progress(pictures, monkeypatch):
    """The progress counts every image of the list, including unreadable ones."""
    counted = []

    class Bar(convert_imageset.ProgressBar):
        def __call__(self, count):
            counted.append((count, self.total))

    monkeypatch.setattr(convert_imageset, "ProgressBar", Bar)
    run_tool("convert_imageset", "p/", "list.txt", "db")
    assert counted == [(1, 5)] * 5
