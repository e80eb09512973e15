"""Data: LMDB databases."""

import os

import cv2
import lmdb
import numpy as np
import pytest

import netlib
from tests.support.bad_input import bad_inputs
from tests.support.caffe_messages import datum, write_blob


def write(folder, entries, subdir=True):
    """Write a database of entries ``00000000 -> bytes``."""
    with (
        lmdb.open(str(folder), map_size=1 << 20, subdir=subdir) as database,
        database.begin(write=True) as change,
    ):
        for i, entry in enumerate(entries):
            change.put(f"{i:08}".encode(), entry)
    return folder


@pytest.fixture
def images(rng):
    """Five images of bytes with shape (2, 4, 6)."""
    return rng.integers(0, 256, (5, 2, 4, 6)).astype(np.uint8)


@pytest.fixture
def database(tmp_path, images):
    """A database of the five images with labels 10 to 14."""
    return write(tmp_path / "lmdb", [datum(image, 10 + i) for i, image in enumerate(images)])


def text(path, options="batch_size: 2", more="", top='top: "x" top: "t"', backend="backend: LMDB"):
    return f'layer {{ name: "d" type: "Data" {top} data_param {{ source: "{path}" {backend} {options} }} {more} }}'


def labels(net, count=1):
    """Return the labels of the next batches."""
    return [int(t) for _ in range(count) for t in net.forward()["t"]]


def test_entries_come_in_order_and_go_round(database, images, net_of):
    net = net_of(text(database))
    for batch in ([0, 1], [2, 3], [4, 0], [1, 2]):
        tops = net.forward()
        assert np.array_equal(tops["x"], images[batch])
        assert tops["t"].tolist() == [10 + i for i in batch]


def test_without_labels(database, images, net_of):
    assert np.array_equal(net_of(text(database, top='top: "x"')).forward()["x"], images[:2])


@pytest.mark.parametrize(("force", "channels"), [("force_color", 3), ("force_gray", 1)])
def test_pictures_in_colour_or_in_grey(tmp_path, rng, net_of, force, channels):
    pictures = [rng.integers(0, 256, size).astype(np.uint8) for size in ((4, 5, 3), (4, 5))]
    entries = [datum(cv2.imencode(".png", picture)[1].tobytes(), 0) for picture in pictures]
    path = write(tmp_path / "lmdb", entries)
    assert net_of(text(path, more=f"transform_param {{ {force}: true }}")).forward()["x"].shape == (
        2,
        channels,
        4,
        5,
    )


def test_transformed(database, images, net_of, tmp_path, rng):
    """In TEST the centre is cropped, and each pixel's own mean is subtracted."""
    mean = rng.normal(size=(1, 2, 4, 6)).astype(np.float32)
    write_blob(tmp_path / "mean.binaryproto", mean)
    more = f'transform_param {{ crop_size: 2 scale: 0.5 mean_file: "{tmp_path}/mean.binaryproto" }}'
    x = net_of(text(database, more=more), netlib.TEST).forward()["x"]
    scaled = (images[:2] - mean) * np.float32(0.5)
    assert np.array_equal(x, scaled[:, :, 1:3, 2:4])


def test_a_database_that_is_made_anew(database, images, net_of, tmp_path):
    """A replaced database is read by new nets; existing nets continue to read the old file."""
    old = net_of(text(database))
    database.rename(tmp_path / "old")
    write(database, [datum(images[0], 77)])
    assert labels(net_of(text(database))) == [77, 77]
    assert labels(old) == [10, 11]


@pytest.mark.parametrize("done", range(6))
def test_a_resume_goes_on_with_the_next_entry(database, net_of, done):
    layer = text(database, "batch_size: 3", "transform_param { crop_size: 2 mirror: true }")
    net = net_of(layer, seed=1)
    labels(net, done)
    states = netlib.snapshots.snapshot.as_plain(net.layer_states())
    want = [{name: array.copy() for name, array in net.forward().items()} for _ in range(4)]
    other = net_of(layer, seed=2)
    labels(other, 2)
    other.restore_layer_states(states)
    for batch in want:
        tops = other.forward()
        assert all(np.array_equal(tops[name], array) for name, array in batch.items())


def test_a_resume_with_another_database_starts_over(database, images, tmp_path, net_of):
    net = net_of(text(database))
    labels(net)
    other = net_of(text(write(tmp_path / "other", [datum(images[0], 7), datum(images[0], 8)])))
    other.restore_layer_states(net.layer_states())
    assert labels(other) == [7, 8]


def test_a_database_in_one_file_and_beside_the_prototxt(tmp_path, images, monkeypatch):
    """A database may be a single file; it is searched in the working directory, then next
    to the prototxt.
    """
    write(tmp_path / "file.mdb", [datum(images[0], 5)], subdir=False)
    (tmp_path / "net.prototxt").write_text(text("file.mdb", "batch_size: 1"))
    assert labels(netlib.Net(tmp_path / "net.prototxt", netlib.TRAIN)) == [5]


def test_ignored_options_are_reported(database, net_of, caplog):
    layer = text(
        database,
        "batch_size: 2 prefetch: 9 cache: true rand_skip: 3 force_encoded_color: true crop_size: 2",
    )
    net = net_of(layer)
    assert labels(net) == [10, 11]
    assert net.layer_dict["d"].notes == [f"5 images in {database}"]
    for advice in (
        "crop_size in data_param, as Caffe does; write it in transform_param",
        "force_encoded_color in data_param, as Caffe does; write force_color in transform_param",
        "rand_skip in data_param, as Caffe does",
    ):
        assert f"layer 'd': Data ignores {advice}" in caplog.text
    assert len(caplog.records) == 3


def test_a_database_that_is_cut_under_a_running_net(tmp_path, net_of):
    """If the file is truncated, the position is kept, and a net on the restored file continues with
    the same batch.
    """
    image = np.ones((1, 100, 100), np.uint8)
    database = write(tmp_path / "lmdb", [datum(image, i) for i in range(20)])
    content = (database / "data.mdb").read_bytes()
    layer = text(database, "batch_size: 4")
    net = net_of(layer)
    assert labels(net) == [0, 1, 2, 3]
    os.truncate(database / "data.mdb", 6 * 4096)
    states = netlib.snapshots.snapshot.as_plain(net.layer_states())
    for _ in range(2):
        with pytest.raises(
            netlib.DataError,
            match=r"data\.mdb: was cut to 24576 of \d+ bytes while in use; restore the",
        ):
            net.forward()
        net.restore_layer_states(states)  # as a solver does before writing a snapshot
        assert netlib.snapshots.snapshot.as_plain(net.layer_states()) == states
    (database / "data.mdb").write_bytes(content)
    again = net_of(layer)
    again.restore_layer_states(states)
    assert labels(again) == [4, 5, 6, 7]


SMALL = [datum(np.ones((1, 2, 2), np.uint8), 0)]
LMDB = "backend: LMDB batch_size: 2"
LEVELDB = "error: layer 'd': backend LEVELDB, Caffe's default, is not supported; convert the database to LMDB (with ..."


def truncated(path, pages):
    """Write a database and keep this number of pages of its file."""
    file = write(path, [datum(np.ones((1, 100, 100), np.uint8), 0)] * 20) / "data.mdb"
    os.truncate(file, file.stat().st_size - 4096 if pages < 0 else pages * 4096)


@bad_inputs(
    netlib.DataError,
    {
        "missing": (
            ("gone", lambda path: None, LMDB),
            "...gone: cannot read the database: No such file or directory",
        ),
        "empty folder": (
            ("folder", lambda path: path.mkdir(), LMDB),
            "...folder/data.mdb: cannot read the database: No such file or directory",
        ),
        "text": (
            ("text", lambda path: path.write_text("text" * 5000), LMDB),
            "...text: not an LMDB database",
        ),
        "empty": (
            ("empty", lambda path: write(path, []), LMDB),
            "...empty: the database has no entries",
        ),
        **{
            f"{pages} pages": (
                ("lmdb", lambda path, pages=pages: truncated(path, pages), LMDB),
                f"...data.mdb: truncated: it has {size} bytes, expected at least ...",
            )
            for pages, size in ((-1, 253952), (31, 126976), (2, 8192))
        },
        "no Datum": (
            ("lmdb", lambda path: write(path, [b"\xff"]), "backend: LMDB batch_size: 1"),
            "...lmdb: entry '00000000': byte 0: truncated: the message ends within a number; expected a Datum",
        ),
        "LevelDB": (
            ("lmdb", lambda path: write(path, SMALL), "batch_size: 1 backend: LEVELDB"),
            netlib.LayerError,
            f"net.prototxt:1:...: {LEVELDB}",
        ),
        "LevelDB, by default": (
            ("lmdb", lambda path: write(path, SMALL), "batch_size: 1"),
            netlib.LayerError,
            f"net.prototxt:1:...: {LEVELDB}",
        ),
        "batch_size 0": (
            ("lmdb", lambda path: write(path, SMALL), "backend: LMDB batch_size: 0"),
            netlib.LayerError,
            "net.prototxt:1:...: error: layer 'd': batch_size must be at least 1",
        ),
        "no batch_size": (
            ("lmdb", lambda path: write(path, SMALL), "backend: LMDB"),
            netlib.PrototxtError,
            "net.prototxt:1:...: error: missing required field 'batch_size' in data_param",
        ),
        "another size": (
            (
                "lmdb",
                lambda path: write(path, [datum(np.zeros((c, 4, 5), np.uint8), 0) for c in (3, 1)]),
                LMDB,
            ),
            netlib.LayerError,
            "...: layer 'd': ...lmdb: entry '00000001': the image (C, H, W) (1, 4, 5) "
            "gives (1, 4, 5), the first of its batch (3, 4, 5); expected the same number of channels, ...",
        ),
    },
)
def test_mistakes(tmp_path, net_of, given, rejected):
    name, make, options = given
    make(tmp_path / name)
    with rejected:
        net_of(text(tmp_path / name, options, backend="")).forward()
