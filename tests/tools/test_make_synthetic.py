"""tools/make_synthetic.py"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import pytest

from handpose.datasets import parts
from handpose.synthetic import files
from handpose.synthetic.generator import Generator
from layers.hand.skeleton import NYU_HAND
from tests.support.running import Done, run_python, run_tool, wait_until

TOOL = Path(__file__).parents[2] / "tools" / "make_synthetic.py"


@pytest.fixture(autouse=True)
def files_of_40_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the number of frames per file to 40, so that few frames make several files."""
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 40)


def arguments(out: Path, *more: str, train: int = 70) -> list[str]:
    """Return the arguments of a small run in this process, with frames from two blocks of 64."""
    return ["--out", str(out), "--train", str(train), "--test", "10", "--workers", "1", *more]


def names(folder: Path) -> list[str]:
    """Return the names of all files in a folder, including hidden ones."""
    return sorted(path.name for path in folder.iterdir())


class Made(NamedTuple):
    """The folder that a run has written, and its output."""

    folder: Path
    done: Done


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The results of a small run, for tests that only read them or work on a copy."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "FRAMES_PER_FILE", 40)
        return Made(folder / "files", run_tool("make_synthetic", *arguments(folder / "files")))


def test_files_and_lists(made: Made) -> None:
    """Every frame occurs once, in order, as the generator draws it, and the lists name the files."""
    folder, done = made
    assert names(folder) == ["test.txt", "test_000.h5", "train.txt", "train_000.h5", "train_001.h5"]
    assert (folder / "train.txt").read_text() == f"{folder}/train_000.h5\n{folder}/train_001.h5\n"
    with h5py.File(folder / "train_001.h5") as file:
        assert file.attrs["made_from"] == "synthetic" and file.attrs["seed"] == 0
        np.testing.assert_array_equal(file["index"], np.arange(40, 70))
        before, after = (Generator(0).block(number).arrays() for number in range(2))
        for name in before:
            assert file[name].dtype == before[name].dtype
            np.testing.assert_array_equal(file[name], np.concatenate([before[name][40:], after[name][:6]]))
    assert "70 train and 10 test frames" in done.out and not done.err


def test_depth_can_be_mapped(tmp_path: Path) -> None:
    """Depth is contiguous in the file, neither chunked nor compressed, and starts at a page boundary."""
    run_tool("make_synthetic", *arguments(tmp_path, train=10))
    with h5py.File(tmp_path / "train_000.h5") as file:
        depth = file["depth"]
        offset = depth.id.get_offset()
        assert depth.chunks is None and depth.compression is None and offset % 4096 == 0
        mapped = np.memmap(tmp_path / "train_000.h5", np.float32, "r", offset, depth.shape)
        np.testing.assert_array_equal(mapped, depth[:])


def test_second_run_keeps_everything(made: Made, tmp_path: Path) -> None:
    """A second run changes no file and reports that all exist."""
    shutil.copytree(made.folder, tmp_path, dirs_exist_ok=True)
    run_tool("make_synthetic", *arguments(tmp_path))  # rewrites the lists with the new paths
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert "exist already" in run_tool("make_synthetic", *arguments(tmp_path)).out
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_other_parameters_are_made_again(made: Made, tmp_path: Path) -> None:
    """A larger number of frames keeps unchanged files; another seed replaces all."""
    shutil.copytree(made.folder, tmp_path, dirs_exist_ok=True)
    first = (tmp_path / "train_000.h5").read_bytes()
    run_tool("make_synthetic", *arguments(tmp_path, train=81))
    assert (tmp_path / "train_000.h5").read_bytes() == first
    assert len((tmp_path / "train.txt").read_text().splitlines()) == 3
    run_tool("make_synthetic", *arguments(tmp_path, "--seed", "5", train=5))
    assert (tmp_path / "train_000.h5").read_bytes() != first


def test_workers_change_no_byte(made: Made, tmp_path: Path) -> None:
    """Files of two processes equal those of one, byte for byte."""
    run_tool("make_synthetic", *arguments(tmp_path)[:-1], "2")
    for name in ("train_000.h5", "train_001.h5", "test_000.h5"):
        assert (tmp_path / name).read_bytes() == (made.folder / name).read_bytes()


@pytest.mark.parametrize("name", ["train_001.h5", "elsewhere.h5"])
def test_real_data_is_left_alone(tmp_path: Path, name: str) -> None:
    """Data made from NYU are not replaced without --force, neither directly nor in a list."""
    with h5py.File(tmp_path / name, "w") as file:
        file.attrs["made_from"] = "NYU"
    (tmp_path / "train.txt").write_text(f"{tmp_path / name}\n")
    error = run_tool("make_synthetic", *arguments(tmp_path), status=1).err
    assert error.count("\n") == 1 and "made from NYU" in error and "--force" in error
    assert names(tmp_path) == sorted([name, "train.txt"])
    run_tool("make_synthetic", *arguments(tmp_path, "--force", train=41))


def test_unknown_file_is_left_alone(tmp_path: Path) -> None:
    """A file that is not HDF5 is not replaced."""
    (tmp_path / "test_000.h5").write_text("my notes")
    assert "not a readable HDF5 file" in run_tool("make_synthetic", *arguments(tmp_path), status=1).err
    assert (tmp_path / "test_000.h5").read_text() == "my notes"


def test_a_list_of_others_is_left_alone(tmp_path: Path) -> None:
    """A list of unknown files is not replaced, even if they are missing; own files may have paths from elsewhere."""
    (tmp_path / "train.txt").write_text("real/train_000.h5\n")
    done = run_tool("make_synthetic", *arguments(tmp_path, train=5), status=1)
    assert "train.txt: names 'real/train_000.h5', which is not there" in done.err
    assert names(tmp_path) == ["train.txt"]
    run_tool("make_synthetic", *arguments(tmp_path, "--force", train=5))
    (tmp_path / "train.txt").write_text(f"{tmp_path.name}/train_000.h5\n")
    run_tool("make_synthetic", *arguments(tmp_path, train=5))


def test_failure_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that fails in its second file keeps only the first; the next run completes the data."""
    whole = files.generate

    def failing(count: int, generator: Generator, workers: int, start: int) -> Iterator[object]:
        yield from whole(10, generator, workers, start)
        if start:
            raise OSError(28, "No space left on device")
        yield from whole(count - 10, generator, workers, start + 10)

    monkeypatch.setattr(files, "generate", failing)
    error = run_tool("make_synthetic", *arguments(tmp_path), status=1).err
    assert error == f"{tmp_path}: No space left on device\n"
    assert names(tmp_path) == ["train_000.h5"]
    monkeypatch.setattr(files, "generate", whole)
    assert "made 40 of them" in run_tool("make_synthetic", *arguments(tmp_path)).out


def test_small_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Insufficient disk space is reported before the work."""
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10**6, 0, 10**6))  # type: ignore[attr-defined]
    assert "needs 5 MB, 1 MB are free" in run_tool("make_synthetic", *arguments(tmp_path), status=1).err


def test_disk_that_fills(tmp_path: Path) -> None:
    """A failed write inside HDF5 is reported on one line with its reason and leaves no file."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4_000_000, 4_000_000))

    command = [TOOL, *arguments(tmp_path / "out")]
    done = run_python(*command, status=1, preexec_fn=limit)
    assert done.out == ""
    assert done.err == f"{tmp_path / 'out'}: File too large\n"
    assert names(tmp_path / "out") == []


def test_folder_that_cannot_be(tmp_path: Path) -> None:
    """A file in place of the output folder gives a one-line error."""
    (tmp_path / "file").write_text("")
    assert run_tool("make_synthetic", *arguments(tmp_path / "file"), status=1).err.count("\n") == 1


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_folder(tmp_path: Path) -> None:
    """A read-only folder is reported."""
    tmp_path.chmod(0o555)
    assert "Permission denied" in run_tool("make_synthetic", *arguments(tmp_path), status=1).err


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals(tmp_path: Path, number: signal.Signals, status: int) -> None:
    """Ctrl-C and SIGTERM end the run and its workers with one line, leaving only complete files."""
    out = tmp_path / "out"
    command = [sys.executable, str(TOOL), "--out", str(out), "--train", "100000", "--workers", "2"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        wait_until(lambda: list(out.glob(".*.tmp")), process)
        if number == signal.SIGINT:
            os.killpg(process.pid, number)  # as a terminal does: to all processes
        else:
            process.send_signal(number)
        stdout, stderr = process.communicate(timeout=300)
    assert (process.returncode, stdout) == (status, "")
    assert stderr == "stopped; whole files are kept, and the next run continues after them\n"
    assert all(name.startswith("train_") and name.endswith(".h5") for name in names(out))


@pytest.mark.parametrize(
    "wrong", [("--train", "0"), ("--workers", "-1"), ("--seed", "x"), ("--seed", "4294967296"), ("--tset", "5")]
)
def test_usage(wrong: tuple[str, str]) -> None:
    """Invalid options give exit status 2 and are named."""
    assert wrong[0] in run_tool("make_synthetic", *wrong, status=2).err


def test_help() -> None:
    """--help shows a command that can be copied."""
    assert "python tools/make_synthetic.py --out data/nyu" in run_tool("make_synthetic", "--help").out


def test_places(tmp_path: Path) -> None:
    """--places writes training data for a locator; --recipe applies only to hands."""
    out = str(tmp_path / "places")
    done = run_tool("make_synthetic", "--places", "--out", out, "--train", "5", "--test", "3", "--workers", "1")
    assert done.out.startswith(f"{out}: 5 train and 3 test places (synthetic, seed 0); made 8 of them in")
    with h5py.File(f"{out}/train_000.h5") as file:
        assert {name: file[name].shape for name in file} == {
            "depth": (5, 1, 64, 64), "hand": (5,), "offset": (5, 3), "near": (5, 3), "index": (5,)
        }
    done = run_tool("make_synthetic", "--places", "--recipe", "cameras", status=2)
    assert "--recipe applies only to hands" in done.err


def test_another_body_is_left_alone(tmp_path: Path) -> None:
    """Frames of another body are replaced only with --force."""
    body = ["--body", str(NYU_HAND.parents[1] / "body" / "arm_prior.prototxt")]
    run_tool("make_synthetic", *arguments(tmp_path, train=10))
    before = (tmp_path / "train_000.h5").read_bytes()
    done = run_tool("make_synthetic", *arguments(tmp_path, *body, train=10), status=1)
    expected = "train_000.h5: holds frames of nyu.prototxt, expected frames of arm.prototxt; choose another folder"
    assert expected in done.err
    assert (tmp_path / "train_000.h5").read_bytes() == before
    run_tool("make_synthetic", *arguments(tmp_path, *body, "--force", train=10))
    assert (tmp_path / "train_000.h5").read_bytes() != before
