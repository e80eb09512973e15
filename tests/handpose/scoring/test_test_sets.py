"""handpose/scoring/held_out.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import netlib
from handpose.frames.cameras import NYU
from handpose.scoring.held_out import centers_of, crops_of, data_layer
from netlib.errors import NetlibError
from netlib.net import Net
from netlib.proto import prototxt
from tests.support.hdf5_files import write_hdf5

INPUT = 'layer { name: "in" type: "Input" top: "depth" input_param { shape { dim: 1 dim: 1 dim: 4 dim: 4 } } }'
DATA = """layer {{ name: "data" type: "HDF5Data" top: "label" top: "depth"
                  hdf5_data_param {{ source: "{}" batch_size: 2 }} }}"""


def net(text: str) -> Net:
    """A test net."""
    return Net(prototxt.parse(text, "net.prototxt"), netlib.TEST)


@pytest.fixture
def of_file(tmp_path: Path) -> Net:
    """A net that reads five crops (1, 4, 4), of which each value is the number of its frame."""
    write_hdf5(
        tmp_path / "a.h5",
        depth=np.ones((5, 1, 4, 4), np.float32) * np.arange(5, dtype=np.float32)[:, None, None, None],
        label=np.zeros((5, 3), np.float32),
    )
    (tmp_path / "list.txt").write_text(f"{tmp_path / 'a.h5'}\n")
    return net(DATA.format(tmp_path / "list.txt"))


def test_the_data_of_a_test_net(of_file: Net) -> None:
    """The layer that reads the test set is found by its type; a net that reads none is an error."""
    assert data_layer(of_file).rows == 5
    with pytest.raises(NetlibError, match="no HDF5Data layer in phase TEST; expected a net that reads a test set"):
        data_layer(net(INPUT))


def test_crops_by_number(of_file: Net) -> None:
    """Crops are read by the number of their frame, in any order."""
    assert [crop.shape for crop in crops_of(of_file, [3, 1])] == [(4, 4)] * 2
    assert [float(crop[0, 0]) for crop in crops_of(of_file, [3, 1])] == [3, 1]


def test_files_without_places(of_file: Net) -> None:
    """Without crop centres in the files there are none, and the camera is NYU's."""
    assert centers_of(of_file, np.arange(2)) == (None, NYU)
