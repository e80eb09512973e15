"""tools/extract_features.py: the blobs of a net in databases."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from layers.data.images import decode_datum
from netlib.proto import prototxt, schema, wire
from netlib.proto.messages import Datum
from tests.support.running import run_tool
from tools.common.databases import read_database

ENGINES = pytest.mark.parametrize("engine", ["plain", "fast"] if netlib.engine.has_fast() else ["plain"])


@pytest.fixture(autouse=True)
def solvers(caffe_data, monkeypatch):
    """Change to the folder of a net that Caffe trained, with data and weights; the batch size is 5."""
    monkeypatch.chdir(caffe_data / "solvers")


def features(path):
    """Return a dict from key to an array (C, H, W)."""
    _, entries = read_database(path)
    return {what.split("'")[1]: decode_datum(value, None, what)[0] for what, value in entries}


@ENGINES
def test_the_values_are_those_of_the_blobs(tmp_path, engine):
    """The values equal those of the blobs in every batch, with two and four axes, in place, and for a loss."""
    blobs = ["conv", "pool", "ip1", "loss"]
    databases = ",".join(str(tmp_path / blob) for blob in blobs)
    argv = ["init.caffemodel", "net.prototxt", ",".join(blobs), databases, "3", "lmdb", "--engine", engine]
    assert run_tool("extract_features", *argv).out.splitlines() == [
        f"{tmp_path}/{blob}: {count} entries" for blob, count in zip(blobs, (15, 15, 15, 3))
    ]
    net = netlib.Net("net.prototxt", "init.caffemodel", netlib.TEST, engine=engine)
    for i in range(3):
        net.forward()
        for blob, shape in zip(blobs, ((6, 11, 11), (6, 6, 6), (16, 1, 1), (1, 1, 1))):
            found = features(tmp_path / blob)
            values = net.blobs[blob].data.reshape(-1, *shape)
            for n, value in enumerate(values, i * len(values)):
                assert np.array_equal(found[f"{n:010d}"], value), (blob, n)


def test_an_entry(tmp_path):
    """A Datum holds floats, no bytes and no label."""
    run_tool("extract_features", "init.caffemodel", "net.prototxt", "ip2", tmp_path / "f", "1", "lmdb", "CPU")
    _, entries = read_database(tmp_path / "f")
    datum = schema.read(wire.decode(next(entries)[1], Datum), Datum)
    assert (datum.channels, datum.height, datum.width, datum.data, datum.label) == (5, 1, 1, b"", 0)
    assert datum.float_data.dtype == np.float32


def test_a_net_reads_them(tmp_path):
    """A net can read the features as data."""
    run_tool(
        "extract_features", "init.caffemodel", "net.prototxt", "ip1", tmp_path / "f", "1", "lmdb", "GPU", "DEVICE_ID=0"
    )
    net = netlib.Net(prototxt.parse(f"""layer {{ name: "d" type: "Data" top: "x"
        data_param {{ source: "{tmp_path}/f" batch_size: 5 backend: LMDB }} }}"""), netlib.TEST)
    first = netlib.Net("net.prototxt", "init.caffemodel", netlib.TEST)
    first.forward()
    assert np.array_equal(net.forward()["x"].reshape(5, 16), first.blobs["ip1"].data)


def test_gpu_is_noted(tmp_path):
    """The argument GPU gives one note."""
    done = run_tool("extract_features", "init.caffemodel", "net.prototxt", "ip1", tmp_path / "f", "1", "lmdb", "GPU")
    assert done.err == "GPU is accepted, but this runs on the CPU\n"


def test_mistakes(tmp_path):
    """Errors are one line each, and no database is written."""
    deep = tmp_path / "deep.prototxt"
    deep.write_text('layer { name: "x" type: "DummyData" top: "x" dummy_data_param { shape { dim: 1 dim: 1 dim: 1 '
                    "dim: 1 dim: 1 } } }")
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    refused = (
        ["init.caffemodel", "net.prototxt", "ip7,ip1", f"{a},{b}", "1", "lmdb"],
        ["init.caffemodel", "none.prototxt", "ip1", a, "1", "lmdb"],
        ["none.caffemodel", "net.prototxt", "ip1", a, "1", "lmdb"],
        ["init.caffemodel", str(deep), "x", a, "1", "lmdb"],
        ["init.caffemodel", "net.prototxt", "ip1,ip1", f"{a},{a}", "1", "lmdb"],
    )
    assert "".join(run_tool("extract_features", *argv, status=1).err for argv in refused).splitlines() == [
        "net.prototxt: the net has no blob 'ip7' (did you mean 'ip2'?)",
        "none.prototxt: cannot read the prototxt: No such file or directory",
        "none.caffemodel: cannot read weights: No such file or directory",
        f"{deep}: blob 'x' has shape (1, 1, 1, 1, 1); a Datum holds items with at most three axes",
        f"{a}: is named twice; expected a new name for each database",
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["deep.prototxt"]


def test_wrong_usage():
    """Wrong usage gives argparse's message and status 2."""
    for argv, message in (
        (["w", "n", "a,b", "d", "1", "lmdb"], "2 blobs, but 1 databases; expected one per blob"),
        (["w", "n", "a", "d", "0", "lmdb"], "expected an integer of at least 1, found '0'"),
        (["w", "n", "a", "d", "1", "leveldb"], "leveldb is not supported"),
        (["w", "n", "a", "d", "1"], "the following arguments are required: lmdb"),
    ):
        assert message in run_tool("extract_features", *argv, status=2).err
