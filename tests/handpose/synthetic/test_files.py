"""handpose/synthetic/files.py"""

from __future__ import annotations

import os
import select
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handpose.datasets import parts
from handpose.datasets.frames import Frames
from handpose.synthetic.files import DataSet, generate
from handpose.synthetic.generator import BLOCK, Generator
from netlib.errors import DataError

SOURCES = [(Generator(split="train"), 5), (Generator(split="test"), 2)]


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts have 2 frames per file."""
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 2)


def test_whole_files_are_kept(tmp_path: Path) -> None:
    """Complete files of an interrupted run are kept; the next run writes the others, and
    a missing list.
    """
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
    with h5py.File(tmp_path / "train_002.h5") as file:
        assert file["index"][...].tolist() == [4] and file.attrs["made_from"] == "synthetic"
    (tmp_path / "test.txt").unlink()
    data = DataSet(tmp_path, SOURCES)
    assert (data.missing_frames, data.is_whole) == (0, False)
    data.write(1, lambda count: pytest.fail("writes frames"))
    assert (tmp_path / "test.txt").read_text() == f"{tmp_path}/test_000.h5\n"
    with pytest.raises(DataError, match=r"needs \d+ MB, \d+ MB are free"):
        DataSet(tmp_path, [(Generator(split="train"), 10**8)])


def test_generate_cuts_anywhere(generator: Generator, frames: Frames) -> None:
    pieces = list(generate(BLOCK, generator, start=BLOCK // 2))
    assert [len(piece) for piece in pieces] == [BLOCK // 2, BLOCK // 2]
    assert_array_equal(pieces[0].depth, frames.depth[BLOCK // 2 :])
    assert_array_equal(
        np.concatenate([p.index for p in pieces]), np.arange(BLOCK // 2, BLOCK * 3 // 2)
    )
    (few,) = generate(3, generator)
    assert_array_equal(few.joint, frames.joint[:3])
    assert not list(generate(0, generator))


@pytest.mark.skipif(
    not hasattr(os, "pidfd_open"),
    reason="waiting for a process that is not a child needs pidfd_open",
)
def test_workers_do_not_outlive_their_parent(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        "import os, sys\n"
        "from handpose.synthetic.files import processes\n"
        "if __name__ == '__main__':\n"
        "    with processes(2) as pool:\n"
        "        print(pool.submit(os.getpid).result(), flush=True)\n"
        "        sys.stdin.read()\n"
    )
    own = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[3])}
    command = [sys.executable, str(script)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=own
    ) as parent:
        assert parent.stdout is not None
        worker = os.pidfd_open(int(parent.stdout.readline()))
        try:
            parent.kill()
            ended, _, _ = select.select([worker], [], [], 60)
        finally:
            os.close(worker)
    assert ended
