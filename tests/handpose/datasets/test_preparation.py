"""handpose/datasets/preparation.py; more of it in the tests of tools/prepare_nyu.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handpose.datasets import parts
from handpose.datasets.preparation import PreparedSplit
from handpose.datasets.published_frames import PublishedFrames
from handpose.frames.cameras import ICVL
from handpose.frames.images import MISSING, BadFrameError
from netlib.blob import Array
from netlib.errors import DataError


def split_of(folder: Path, bad: range, count: int = 7) -> PublishedFrames:
    """Frames with a plate at the centre; the frames in ``bad`` cannot be read."""

    def read(path: Path) -> Array:
        if int(path.stem) in bad:
            raise BadFrameError(path, MISSING)
        return np.full((ICVL.height, ICVL.width), 400.0)

    center = np.tile([160.0, 120.0, 400.0], (count, 1))
    files = [folder / f"{i}.png" for i in range(count)]
    joints = np.repeat(ICVL.unproject(center)[:, None], 16, axis=1)
    return PublishedFrames("test", files, center, joints, np.full(count, 250.0), ICVL, read, "a test", "the middle")


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts have 3 frames per file."""
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 3)


def test_bad_frames_are_named_and_left_out(tmp_path: Path) -> None:
    """A part without good frames is not listed; a second run writes nothing and gives the same report."""
    reports: list[str] = []
    for missing in (3, 0):
        split = PreparedSplit(split_of(tmp_path, range(2, 6)), tmp_path)
        assert [len(split.parts), len(split.missing)] == [3, missing]
        outcome = split.write(2, lambda count: None, lambda i, error: None)
        split.write_list(outcome)
        assert (outcome.index, outcome.made) == ([0, 1, 6], missing)
        assert split.list.read_text() == f"{tmp_path}/test_000.h5\n{tmp_path}/test_002.h5\n"
        assert [line[:8] for line in split.bad.read_text().splitlines()] == [f"frame {i}:" for i in range(2, 6)]
        reports.append(split.report(outcome))
    assert reports[0] == reports[1]
    assert reports[0].startswith(
        "test: 3 frames (a test), 4 bad frames left out: 4 no such file\ntest: joints x 0 to 0"
    )


def test_a_repaired_frame_is_taken_in(tmp_path: Path) -> None:
    """A repaired frame is added although the file's size and the recipe are unchanged; other parts are kept."""
    for bad, missing, index in ((range(4, 6), 3, [0, 1, 2, 3, 6]), (range(5, 6), 1, [0, 1, 2, 3, 4, 6])):
        split = PreparedSplit(split_of(tmp_path, bad), tmp_path)
        assert len(split.missing) == missing
        assert sorted(split.write(1, lambda count: None, lambda i, error: None).index) == index


def test_a_split_without_good_frames(tmp_path: Path) -> None:
    (tmp_path / "test.txt").write_text("old.h5\n")
    split = PreparedSplit(split_of(tmp_path, range(7)), tmp_path)
    outcome = split.write(1, lambda count: None, lambda i, error: None)
    with pytest.raises(DataError, match="none of the 7 test frames can be used"):
        split.write_list(outcome)
    assert not split.list.exists()


def test_the_first_bad_frame_may_end_the_run(tmp_path: Path) -> None:
    """An error raised by ``on_bad`` ends the run; finished files stay."""

    def strict(i: int, error: BadFrameError) -> None:
        raise error

    split = PreparedSplit(split_of(tmp_path, range(4, 5)), tmp_path)
    with pytest.raises(BadFrameError, match=r"4\.png: no such file"):
        split.write(1, lambda count: None, strict)
    assert [path.name for path in tmp_path.iterdir()] == ["test_000.h5"]
