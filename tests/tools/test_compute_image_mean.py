"""tools/compute_image_mean.py: the mean of a database, as a file for transform_param and as printed numbers."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import netlib
from netlib.proto import prototxt
from netlib.proto.binaryproto import read_blob
from netlib.proto.messages import Datum
from tests.support.running import run_tool
from tools.common.databases import write_databases


@pytest.fixture
def images(tmp_path, monkeypatch, rng):
    """Seven images of bytes with shape (3, 4, 5), in the database db."""
    monkeypatch.chdir(tmp_path)
    images = rng.integers(0, 256, (7, 3, 4, 5)).astype(np.uint8)
    write(tmp_path / "db", [Datum(3, 4, 5, image.tobytes()) for image in images])
    return images


def write(path, datums):
    def fill(writers):
        for i, datum in enumerate(datums):
            writers[0].put(f"{i:08d}", datum)

    assert write_databases([path], fill) == 0


def test_the_mean(images):
    """The mean is (1, C, H, W) in float32, and the printed numbers are those of Caffe."""
    done = run_tool("compute_image_mean", "-backend=lmdb", "db", "mean.binaryproto")
    mean = read_blob("mean.binaryproto")
    assert mean.shape == (1, 3, 4, 5) and mean.dtype == np.float32
    assert np.allclose(mean[0], images.mean(axis=0), rtol=1e-6)
    lines = done.out.splitlines()
    assert lines[0] == "Number of channels: 3"
    assert lines[1:] == [f"mean_value channel [{c}]: {images[:, c].mean():.6g}" for c in range(3)]


def test_a_net_that_subtracts_it_has_the_mean_zero(images):
    """After subtracting the mean image, the mean over all images is 0 for every pixel."""
    run_tool("compute_image_mean", "db", "mean.binaryproto")
    net = netlib.Net(prototxt.parse("""layer { name: "d" type: "Data" top: "x"
        data_param { source: "db" batch_size: 7 backend: LMDB }
        transform_param { mean_file: "mean.binaryproto" } }"""), netlib.TEST)
    x = net.forward()["x"]
    assert np.abs(x).mean() > 10
    assert np.abs(x.mean(axis=0)).max() < 1e-4


def test_floats_and_pictures(tmp_path, images, rng):
    """The mean of floats and of encoded images is computed as well."""
    floats = rng.normal(size=(2, 1, 3, 4)).astype(np.float32)
    write(tmp_path / "floats", [Datum(1, 3, 4, float_data=one.ravel()) for one in floats])
    run_tool("compute_image_mean", "floats", "floats.binaryproto")
    assert np.allclose(read_blob("floats.binaryproto")[0], floats.mean(axis=0), atol=1e-7)
    files = [cv2.imencode(".png", image.transpose(1, 2, 0))[1].tobytes() for image in images]
    write(tmp_path / "files", [Datum(data=content, encoded=True) for content in files])
    run_tool("compute_image_mean", "files", "files.binaryproto")
    assert np.allclose(read_blob("files.binaryproto")[0], images.mean(axis=0), rtol=1e-6)


def test_without_a_file(images, tmp_path):
    """Without an output file only the numbers are printed."""
    assert len(run_tool("compute_image_mean", "db").out.splitlines()) == 4
    assert [path.name for path in tmp_path.iterdir()] == ["db"]


def test_mistakes(tmp_path, images):
    """Errors are one line each, and no mean is written."""
    write(tmp_path / "sizes", [Datum(1, 1, 2, b"ab"), Datum(1, 2, 1, b"ab")])
    write(tmp_path / "bad", [Datum(1, 1, 2, b"abc")])
    refused = (["sizes", "m"], ["bad", "m"], ["none", "m"], ["db", "db"])
    assert "".join(run_tool("compute_image_mean", *argv, status=1).err for argv in refused).splitlines() == [
        "sizes: entry '00000001': the image (C, H, W) is (1, 2, 1), the first (1, 1, 2); expected equal shapes; "
        "convert_imageset.py can resize images",
        "bad: entry '00000000': a Datum with channels, height, width (1, 1, 2) has 3 values",
        "none: cannot read the database: No such file or directory",
        "db: is read in this run; expected another output",
    ]
    assert not (tmp_path / "m").exists()


def test_wrong_usage():
    """Wrong usage gives argparse's message and status 2."""
    for argv in ([], ["db", "m", "more"], ["-backend", "leveldb", "db"]):
        run_tool("compute_image_mean", *argv, status=2)
