"""HDF5Output."""

from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib
from tests.support.bad_input import bad_inputs
from tests.support.hdf5_files import write_hdf5


def text(path, x="dim: 2 dim: 3", t="dim: 2"):
    """Return a net of two inputs that are written to ``path``."""
    return (
        f'force_backward: true layer {{ name: "in" type: "Input" top: "x" top: "t" input_param {{ shape {{ {x} }} '
        f'shape {{ {t} }} }} }} layer {{ name: "out" type: "HDF5Output" bottom: "x" bottom: "t" '
        f'hdf5_output_param {{ file_name: "{path}" }} }}'
    )


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_first_batch_is_written_with_four_axes(here, net_of, rng, dtype):
    """The batch has the net's type and four axes, and replaces an older file."""
    path = Path("out.h5")
    path.write_text("old")
    net = net_of(text(path), dtype=dtype)
    assert path.read_text() == "old", "nothing is lost before the new file is whole"
    x, t = rng.normal(size=(2, 3)).astype(dtype), np.array([5.0, 6], dtype)
    net.forward(x=x, t=t)
    with h5py.File(path) as file:
        assert sorted(file) == ["data", "label"]
        assert file["data"].dtype == dtype
        assert np.array_equal(file["data"], x.reshape(2, 3, 1, 1))
        assert np.array_equal(file["label"], t.reshape(2, 1, 1, 1))
    assert [p.name for p in here.iterdir()] == ["out.h5"]


def test_a_second_batch_is_a_mistake(here, net_of):
    net = net_of(text("out.h5"))
    net.forward(x=np.ones((2, 3)))
    with pytest.raises(
        netlib.LayerError, match=r"layer 'out': .*out.h5 holds the batch of the first forward"
    ):
        net.forward(x=np.zeros((2, 3)))
    with h5py.File("out.h5") as file:
        assert (file["data"][...] == 1).all()


def test_its_bottoms_have_no_gradient(here, net_of):
    net = net_of(text("out.h5"))
    net.forward()
    net.blobs["x"].diff[...] = 3
    assert (net.backward()["x"] == 0).all()


@pytest.mark.parametrize("name", ["in.h5", "link.h5"])
def test_a_file_that_is_read_is_not_replaced(here, net_of, name):
    write_hdf5("in.h5", x=np.ones((4, 3)), t=np.ones((4, 1)))
    Path("link.h5").symlink_to("in.h5")
    Path("list.txt").write_text("in.h5")
    before = Path("in.h5").read_bytes()
    data = (
        'layer { name: "d" type: "HDF5Data" top: "x" top: "t" hdf5_data_param { source: "list.txt" '
        "batch_size: 4 } }"
    )
    out = (
        f'layer {{ name: "out" type: "HDF5Output" bottom: "x" bottom: "t" hdf5_output_param {{ '
        f'file_name: "{name}" }} }}'
    )
    with pytest.raises(
        netlib.LayerError, match=rf"layer 'out': file_name '.*{name}' is read by a net; write to"
    ):
        net_of(data + out)
    assert Path("in.h5").read_bytes() == before


@bad_inputs(
    netlib.LayerError,
    {
        "no folder": (
            ("gone/out.h5", {}),
            "...: error: layer 'out': file_name '...gone/out.h5': ...gone is not a folder",
        ),
        "a folder": (("", {}), "...: error: layer 'out': file_name '...' is not a file name"),
        "items": (
            ("out.h5", {"t": "dim: 3"}),
            "...: error: layer 'out': bottoms 'x' (2, 3) and 't' (3,) must have the same number of items",
        ),
        "axes": (
            ("out.h5", {"x": "dim: 2 " * 5}),
            "...: error: layer 'out': bottom 'x' (2, 2, 2, 2, 2) has more than four axes",
        ),
    },
)
def test_mistakes(here, net_of, given, rejected):
    with rejected:
        net_of(text(f"{given[0]}", **given[1]))


def test_a_file_that_cannot_be_written(here, net_of):
    Path("folder").mkdir()
    net = net_of(text("folder/o"))
    Path("folder").rmdir()
    with pytest.raises(
        netlib.DataError, match=r"folder/o: cannot write the HDF5 file: .*No such file or directory"
    ):
        net.forward()
