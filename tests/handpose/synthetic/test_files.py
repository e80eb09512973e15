"""handpose/synthetic/files.py"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from handpose.datasets import parts
from handpose.synthetic.files import DataSet, pieces_of
from handpose.synthetic.generator import Generator
from netlib.errors import DataError

SOURCES = [(Generator(split="train"), 5), (Generator(split="test"), 2)]


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts have 2 frames per file."""
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 2)


def test_pieces(tmp_path: Path) -> None:
    """Pieces follow one another, and the last one has the remaining frames."""
    pieces = pieces_of(Generator(), 5, tmp_path)
    assert [(piece.start, piece.part.rows, piece.part.path.name) for piece in pieces] == [
        (0, 2, "train_000.h5"),
        (2, 2, "train_001.h5"),
        (4, 1, "train_002.h5"),
    ]
    assert len({piece.part.recipe for piece in pieces}) == 3


def test_depth_can_be_mapped(tmp_path: Path) -> None:
    """Depth is contiguous in the file, neither chunked nor compressed, and starts at a page boundary."""
    DataSet(tmp_path, SOURCES).write(1, lambda count: None)
    with h5py.File(tmp_path / "train_000.h5") as file:
        depth = file["depth"]
        offset = depth.id.get_offset()
        assert depth.chunks is None and depth.compression is None and offset % 4096 == 0
        mapped = np.memmap(tmp_path / "train_000.h5", np.float32, "r", offset, depth.shape)
        np.testing.assert_array_equal(mapped, depth[:])


def test_whole_files_are_kept(tmp_path: Path) -> None:
    """Complete files of an interrupted run are kept; the next run writes the others, and the lists at the end."""
    reported: list[int] = []

    def advance(count: int) -> None:
        reported.append(count)
        if sum(reported) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        DataSet(tmp_path, SOURCES).write(1, advance)
    assert [path.name for path in tmp_path.iterdir()] == ["train_000.h5"]
    data = DataSet(tmp_path, SOURCES)
    assert (data.missing_frames, data.is_whole) == (5, False)
    data.write(1, lambda count: None)
    assert DataSet(tmp_path, SOURCES).is_whole
    assert (tmp_path / "test.txt").read_text() == f"{tmp_path}/test_000.h5\n"
    with h5py.File(tmp_path / "train_002.h5") as file:
        assert file["index"][...].tolist() == [4] and file.attrs["made_from"] == "synthetic"


def test_a_run_without_room_changes_nothing(tmp_path: Path) -> None:
    """Insufficient disk space raises an error before anything is written, for any number of files."""
    DataSet(tmp_path, SOURCES).write(1, lambda count: None)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    for count in (10**8, 10**11):
        with pytest.raises(DataError, match=r"needs \d+ MB, \d+ MB are free"):
            DataSet(tmp_path, [(Generator(split="train"), count)])
        assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_lists_stand_until_there_is_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Disk space is checked again before writing, and if it is full, the lists are kept."""
    DataSet(tmp_path, SOURCES).write(1, lambda count: None)
    data = DataSet(tmp_path, [(Generator(split="train"), 50)])
    monkeypatch.setattr(parts, "check_room", lambda out, need: (_ for _ in ()).throw(DataError("full")))
    with pytest.raises(DataError, match="full"):
        data.write(1, lambda count: None)
    assert (tmp_path / "train.txt").exists()


def test_a_missing_list_is_written_again(tmp_path: Path) -> None:
    """A missing list is written again, without writing frames."""
    DataSet(tmp_path, SOURCES).write(1, lambda count: None)
    (tmp_path / "train.txt").unlink()
    data = DataSet(tmp_path, SOURCES)
    assert (data.missing_frames, data.is_whole) == (0, False)
    data.write(1, lambda count: pytest.fail("writes frames"))
    assert (tmp_path / "train.txt").exists()
