"""The order in which HDF5Data reads rows, compared with real Caffe."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib

pytestmark = pytest.mark.both_engines


@pytest.fixture
def hdf5data(caffe_data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder with the data, as the working directory: nets and lists refer to their
    files from there.
    """
    monkeypatch.chdir(caffe_data / "hdf5data")
    return caffe_data / "hdf5data"


def test_rows_come_in_caffes_order(hdf5data: Path) -> None:
    """Without shuffle, batches continue across file ends, wrap around, and may be larger
    than the data.
    """
    recorded = np.load("hdf5data.npz")
    ran = 0
    for case in json.loads(Path("index.json").read_text()):
        if "shuffle" in case["extra"]:
            continue
        net = netlib.Net(f"{case['case']}.prototxt", netlib.TRAIN)
        for i in range(case["iters"]):
            tops = net.forward()
            assert sorted(tops) == ["data", "label", "vec"]
            for blob, array in tops.items():
                assert np.array_equal(array, recorded[f"{case['case']}/{blob}"][i]), (
                    case["case"],
                    blob,
                    i,
                )
        ran += 1
    assert ran == 6


@pytest.mark.parametrize("case", ["shuffle_b7", "shuffle_one_b7"])
def test_files_and_the_rows_of_a_file_are_shuffled(hdf5data: Path, case: str) -> None:
    """Every pass, in Caffe's recording and in netlib, has the rows of one file after the other,
    in a new order.
    """
    index = {entry["case"]: entry for entry in json.loads(Path("index.json").read_text())}[case]
    file_of = {}
    for name in Path(index["source"]).read_text().split():
        with h5py.File(name) as file:
            file_of.update(dict.fromkeys(np.ravel(file["label"]).tolist(), name))
    net, size = netlib.Net(f"{case}.prototxt", netlib.TRAIN, seed=3), len(file_of)
    theirs = np.load("hdf5data.npz")[f"{case}/label"]
    assert theirs.shape[:2] == (index["iters"], 7)
    for labels in (theirs, np.array([net.forward()["label"].copy() for _ in range(40)])):
        rows = labels.ravel().tolist()
        starts = range(0, len(rows) - size + 1, size)
        passes = [rows[i : i + size] for i in starts]
        assert len({tuple(order) for order in passes}) == len(passes) > 1
        for order in passes:
            assert sorted(order) == sorted(file_of)
            changes = sum(
                file_of[one] != file_of[other] for one, other in itertools.pairwise(order)
            )
            assert changes == len(set(file_of.values())) - 1
        assert len({file_of[order[0]] for order in passes}) == len(set(file_of.values()))
