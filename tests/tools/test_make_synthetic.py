"""tools/make_synthetic.py"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from handpose.datasets import parts
from layers.hand.skeleton import NYU_HAND
from tests.support.running import Done, run_tool

TOOL = Path(__file__).parents[2] / "tools" / "make_synthetic.py"


@pytest.fixture(autouse=True)
def files_of_40_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the number of frames per file to 40, so that few frames make several files."""
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 40)


def arguments(out: Path, *more: str, train: int = 70) -> list[str]:
    """Return the arguments of a small run in this process, with frames from two blocks of 64."""
    return ["--out", str(out), "--train", str(train), "--test", "10", "--workers", "1", *more]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Done]:
    """The folder and the output of a small run, for tests that only read the files or
    work on a copy.
    """
    folder = tmp_path_factory.mktemp("made") / "files"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "FRAMES_PER_FILE", 40)
        return folder, run_tool("make_synthetic", *arguments(folder))


def test_files_and_lists(made: tuple[Path, Done]) -> None:
    """Every frame occurs once, in order, and the lists name the files."""
    folder, done = made
    assert names(folder) == ["test.txt", "test_000.h5", "train.txt", "train_000.h5", "train_001.h5"]
    assert (folder / "train.txt").read_text() == f"{folder}/train_000.h5\n{folder}/train_001.h5\n"
    with h5py.File(folder / "train_001.h5") as file:
        assert file.attrs["made_from"] == "synthetic"
        assert file.attrs["seed"] == 0
        np.testing.assert_array_equal(file["index"], np.arange(40, 70))
    assert "70 train and 10 test frames" in done.out
    assert not done.err


def test_a_second_run_keeps_unchanged_files(made: tuple[Path, Done], tmp_path: Path) -> None:
    """The same arguments change no file, a larger number of frames keeps unchanged files, another
    seed replaces all.
    """
    shutil.copytree(made[0], tmp_path, dirs_exist_ok=True)
    run_tool("make_synthetic", *arguments(tmp_path))  # rewrites the lists with the new paths
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    done = run_tool("make_synthetic", *arguments(tmp_path))
    assert (
        done.out == f"{tmp_path}: 70 train and 10 test frames (synthetic, seed 0) exist already\n"
    )
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before
    first = (tmp_path / "train_000.h5").read_bytes()
    run_tool("make_synthetic", *arguments(tmp_path, train=81))
    assert (tmp_path / "train_000.h5").read_bytes() == first
    assert len((tmp_path / "train.txt").read_text().splitlines()) == 3
    run_tool("make_synthetic", *arguments(tmp_path, "--seed", "5", train=5))
    with h5py.File(tmp_path / "train_000.h5") as file:
        assert file.attrs["seed"] == 5


def test_workers_change_no_byte(made: tuple[Path, Done], tmp_path: Path) -> None:
    run_tool("make_synthetic", *arguments(tmp_path)[:-1], "2")
    for name in ("train_000.h5", "train_001.h5", "test_000.h5"):
        assert (tmp_path / name).read_bytes() == (made[0] / name).read_bytes()


def test_other_data_are_replaced_only_with_force(tmp_path: Path) -> None:
    """Frames of another body, and a folder's place taken by a file; a refusal is one line and
    changes nothing.
    """
    body = ["--body", str(NYU_HAND.parents[1] / "body" / "arm_prior.prototxt")]
    run_tool("make_synthetic", *arguments(tmp_path, train=10))
    before = (tmp_path / "train_000.h5").read_bytes()
    (error,) = run_tool(
        "make_synthetic", *arguments(tmp_path, *body, train=10), status=1
    ).err.splitlines()
    assert (
        "train_000.h5: holds data made from synthetic frames of nyu.prototxt, expected synthetic frames of "
        in error
    )
    assert (tmp_path / "train_000.h5").read_bytes() == before
    run_tool("make_synthetic", *arguments(tmp_path, *body, "--force", train=10))
    assert (tmp_path / "train_000.h5").read_bytes() != before
    assert (
        run_tool("make_synthetic", *arguments(tmp_path / "test_000.h5"), status=1).err.count("\n")
        == 1
    )


def test_ctrl_c(tmp_path: Path) -> None:
    """Ctrl-C ends the run and its workers with one line, leaving only complete files."""
    out = tmp_path / "out"
    command = [sys.executable, str(TOOL), "--out", str(out), "--train", "100000", "--workers", "2"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        while not list(out.glob(".*.tmp")):
            with contextlib.suppress(subprocess.TimeoutExpired):
                raise AssertionError(f"ended with status {process.wait(0.02)}")
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all processes
        stdout, stderr = process.communicate(timeout=300)
    assert (process.returncode, stdout) == (130, "")
    assert stderr == "stopped; whole files are kept, and the next run continues after them\n"
    assert all(name.startswith("train_") and name.endswith(".h5") for name in names(out))
