"""The order in which HDF5Data reads rows, compared with real Caffe."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib

pytestmark = pytest.mark.both_engines


@pytest.fixture
def hdf5data(caffe_data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder with the data, as the working directory: nets and lists refer to their files from there."""
    monkeypatch.chdir(caffe_data / "hdf5data")
    return caffe_data / "hdf5data"


def test_rows_come_in_caffes_order(hdf5data: Path) -> None:
    """Without shuffle, batches continue across file ends, wrap around, and may be larger than the data."""
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
                assert np.array_equal(array, recorded[f"{case['case']}/{blob}"][i]), (case["case"], blob, i)
        ran += 1
    assert ran == 6


@pytest.mark.parametrize("case", ["shuffle_b7", "shuffle_one_b7"])
def test_files_and_the_rows_of_a_file_are_shuffled(hdf5data: Path, case: str) -> None:
    """Every pass, in Caffe's recording and in netlib, is a permutation of the files and of the rows of each file."""
    index = {entry["case"]: entry for entry in json.loads(Path("index.json").read_text())}[case]
    files = {}
    for name in Path(index["source"]).read_text().split():
        with h5py.File(name) as file:
            files[name] = [float(v) for v in np.ravel(file["label"])]
    theirs = np.load("hdf5data.npz")[f"{case}/label"].ravel()
    assert len(theirs) == index["iters"] * 7
    net = netlib.Net(f"{case}.prototxt", netlib.TRAIN, seed=3)
    ours = np.concatenate([net.forward()["label"].copy() for _ in range(40)])
    size = sum(map(len, files.values()))
    passes = [[float(v) for v in rows[i : i + size]] for rows in (theirs, ours) for i in range(0, len(rows), size)]
    for rows in passes:
        check_pass(rows, list(files.values()))
    complete = {tuple(rows) for rows in passes if len(rows) == size}
    assert len(complete) > 5, "passes must differ"


def check_pass(rows: list[float], files: list[list[float]]) -> None:
    """Assert that a pass reads each file once, and all rows of a file before those of the next."""
    left = [sorted(rows) for rows in files]
    while rows:
        mine = next(file for file in left if rows[0] in file)
        head, rows = rows[: len(mine)], rows[len(mine) :]
        assert sorted(head) == mine or (not rows and set(head) <= set(mine) and len(set(head)) == len(head))
        left.remove(mine)
