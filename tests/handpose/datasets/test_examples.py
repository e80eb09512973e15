"""handpose/datasets/examples.py; more of it in the tests of tools/show_data.py"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from handpose.datasets.examples import examples_of, spread
from netlib.errors import DataError
from tests.support.hdf5_files import write_hdf5


@pytest.mark.parametrize(
    ("total", "count", "numbers"), [(10, 4, [0, 3, 6, 9]), (3, 8, [0, 1, 2]), (5, 1, [0]), (0, 3, [])]
)
def test_spread(total: int, count: int, numbers: list[int]) -> None:
    """The first and the last number are included, and no number occurs twice."""
    assert spread(total, count).tolist() == numbers


def test_frames_of_a_list_come_from_all_its_files(tmp_path: Path) -> None:
    """The frames come in order, with joints where the file has them."""
    for name, value in (("a", 0.25), ("b", 0.5)):
        write_hdf5(tmp_path / f"{name}.h5", depth=np.full((2, 1, 8, 8), value, np.float32))
    with h5py.File(tmp_path / "b.h5", "a") as file:
        file["joint"] = np.arange(12.0).reshape(2, 6)
    (tmp_path / "list.txt").write_text("a.h5\nb.h5\n")
    (crop, none, first), (other, joints, last) = examples_of(tmp_path / "list.txt", 2)
    assert (first, last) == (f"{tmp_path}/a.h5: frame 0", f"{tmp_path}/b.h5: frame 1")
    assert crop.shape == (8, 8) and none is None
    assert (crop[0, 0], other[0, 0]) == (0.25, 0.5)
    assert joints is not None and joints.tolist() == [6, 7, 8, 9, 10, 11]


def test_a_folder_without_pictures(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no PNG pictures in this folder"):
        examples_of(tmp_path, 3)
