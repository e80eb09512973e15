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

import cv2
import h5py
import numpy as np
import pytest

from handpose.data import parts
from handpose.facts.nyu import CENTER_JOINT, frame_name
from handpose.importers import nyu_files
from handpose.synthetic import files
from handpose.synthetic.generator import Generator
from layers.hand.skeleton import NYU_HAND
from tests.support.running import Done, run_python, run_tool, wait_until

TOOL = Path(__file__).parents[2] / "tools" / "make_synthetic.py"


@pytest.fixture(autouse=True)
def files_of_40_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that few frames make several files."""
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 40)


def arguments(out: Path, *more: str, train: int = 70) -> list[str]:
    """A small run in this process, of frames from two blocks of 64."""
    return ["--out", str(out), "--train", str(train), "--test", "10", "--workers", "1", *more]


def names(folder: Path) -> list[str]:
    """All that is in a folder, hidden files too."""
    return sorted(path.name for path in folder.iterdir())


class Made(NamedTuple):
    """The folder that a run has written, and what it printed."""

    folder: Path
    done: Done


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Made]:
    """What a small run of either kind writes, for tests that only read it or that go on from a copy."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "FRAMES_PER_FILE", 40)
        files = run_tool("make_synthetic", *arguments(folder / "files"))
    images = run_tool("make_synthetic", *raw(folder / "raw", train=70))
    return {"files": Made(folder / "files", files), "raw": Made(folder / "raw", images)}


def test_files_and_lists(made: dict[str, Made]) -> None:
    """Every frame is there once, in order, as the generator draws it; the lists name the files."""
    folder, done = made["files"]
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
    """Frames lie in the file in one piece, neither chunked nor compressed, from a page border on."""
    run_tool("make_synthetic", *arguments(tmp_path, train=10))
    with h5py.File(tmp_path / "train_000.h5") as file:
        depth = file["depth"]
        offset = depth.id.get_offset()
        assert depth.chunks is None and depth.compression is None and offset % 4096 == 0
        mapped = np.memmap(tmp_path / "train_000.h5", np.float32, "r", offset, depth.shape)
        np.testing.assert_array_equal(mapped, depth[:])


def test_second_run_keeps_everything(made: dict[str, Made], tmp_path: Path) -> None:
    """A run that is already done touches nothing and says so."""
    shutil.copytree(made["files"].folder, tmp_path, dirs_exist_ok=True)
    run_tool("make_synthetic", *arguments(tmp_path))  # the lists name other paths now
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert "exist already" in run_tool("make_synthetic", *arguments(tmp_path)).out
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_other_parameters_are_made_again(made: dict[str, Made], tmp_path: Path) -> None:
    """Another seed replaces synthetic data; a larger number of frames keeps the files that do not change."""
    shutil.copytree(made["files"].folder, tmp_path, dirs_exist_ok=True)
    first = (tmp_path / "train_000.h5").read_bytes()
    run_tool("make_synthetic", *arguments(tmp_path, train=110))
    assert (tmp_path / "train_000.h5").read_bytes() == first
    assert len((tmp_path / "train.txt").read_text().splitlines()) == 3
    run_tool("make_synthetic", *arguments(tmp_path, "--seed", "5"))
    assert (tmp_path / "train_000.h5").read_bytes() != first


def test_workers_change_no_byte(made: dict[str, Made], tmp_path: Path) -> None:
    """Files of two processes are equal to those of one, to the byte."""
    run_tool("make_synthetic", *arguments(tmp_path)[:-1], "2")
    for name in ("train_000.h5", "train_001.h5", "test_000.h5"):
        assert (tmp_path / name).read_bytes() == (made["files"].folder / name).read_bytes()


@pytest.mark.parametrize("name", ["train_001.h5", "elsewhere.h5"])
def test_real_data_is_left_alone(tmp_path: Path, name: str) -> None:
    """Data made from NYU, in the way or named by the list in the way, is not replaced without --force."""
    with h5py.File(tmp_path / name, "w") as file:
        file.attrs["made_from"] = "NYU"
    (tmp_path / "train.txt").write_text(f"{tmp_path / name}\n")
    error = run_tool("make_synthetic", *arguments(tmp_path), status=1).err
    assert error.count("\n") == 1 and "made from NYU" in error and "--force" in error
    assert names(tmp_path) == sorted([name, "train.txt"])
    run_tool("make_synthetic", *arguments(tmp_path, "--force", train=41))


def test_unknown_file_is_left_alone(tmp_path: Path) -> None:
    """Something that is no HDF5 file is not replaced either."""
    (tmp_path / "test_000.h5").write_text("my notes")
    assert "not a readable HDF5 file" in run_tool("make_synthetic", *arguments(tmp_path), status=1).err
    assert (tmp_path / "test_000.h5").read_text() == "my notes"


def test_a_list_of_others_is_left_alone(tmp_path: Path) -> None:
    """Also where what it names is not there from here; our own may be named from another folder."""
    (tmp_path / "train.txt").write_text("real/train_000.h5\n")
    done = run_tool("make_synthetic", *arguments(tmp_path, train=5), status=1)
    assert "train.txt: names 'real/train_000.h5', which is not there" in done.err
    assert names(tmp_path) == ["train.txt"]
    run_tool("make_synthetic", *arguments(tmp_path, "--force", train=5))
    (tmp_path / "train.txt").write_text(f"{tmp_path.name}/train_000.h5\n")
    run_tool("make_synthetic", *arguments(tmp_path, train=5))


def test_failure_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that fails in its second file keeps the first, and nothing else; the next run completes it."""
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
    """Too little room is found out before the work."""
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10**6, 0, 10**6))  # type: ignore[attr-defined]
    assert "needs 5 MB, 1 MB are free" in run_tool("make_synthetic", *arguments(tmp_path), status=1).err


def test_disk_that_fills(tmp_path: Path) -> None:
    """A write that fails inside HDF5 is one line with the plain reason, and leaves nothing."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4_000_000, 4_000_000))

    command = [TOOL, *arguments(tmp_path / "out")]
    done = run_python(*command, status=1, preexec_fn=limit)
    assert done.out == ""
    assert done.err == f"{tmp_path / 'out'}: File too large\n"
    assert names(tmp_path / "out") == []


def test_folder_that_cannot_be(tmp_path: Path) -> None:
    """A file where the folder should be is one clear line."""
    (tmp_path / "file").write_text("")
    assert run_tool("make_synthetic", *arguments(tmp_path / "file"), status=1).err.count("\n") == 1


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_folder(tmp_path: Path) -> None:
    """A folder that may not be written to is one clear line."""
    tmp_path.chmod(0o555)
    assert "Permission denied" in run_tool("make_synthetic", *arguments(tmp_path), status=1).err


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals(tmp_path: Path, number: signal.Signals, status: int) -> None:
    """Ctrl-C and SIGTERM end the run and its workers quietly, leaving whole files only."""
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
        stdout, stderr = process.communicate(timeout=60)
    assert (process.returncode, stdout) == (status, "")
    assert stderr == "stopped; whole files are kept, and the next run continues after them\n"
    assert all(name.startswith("train_") and name.endswith(".h5") for name in names(out))


@pytest.mark.parametrize(
    "wrong", [("--train", "0"), ("--workers", "-1"), ("--seed", "x"), ("--seed", "4294967296"), ("--tset", "5")]
)
def test_usage(wrong: tuple[str, str]) -> None:
    """Wrong numbers and options exit 2 and are named."""
    assert wrong[0] in run_tool("make_synthetic", *wrong, status=2).err


def test_help() -> None:
    """--help shows a command that can be copied."""
    assert "python tools/make_synthetic.py --out data/nyu" in run_tool("make_synthetic", "--help").out


# ------------------------------------------------------------------------------------------ NYU's format


def raw(out: Path, *more: str, train: int = 5) -> list[str]:
    """A small run with --raw."""
    return ["--raw", "--out", str(out), "--train", str(train), "--test", "3", "--workers", "1", *more]


def test_raw_files(made: dict[str, Made]) -> None:
    """One folder per split, with one image per frame and the labels of all 36 joints, not clipped to the cube."""
    folder, done = made["raw"]
    images = [frame_name(i) for i in range(70)]
    assert names(folder / "train") == [*images, "joint_data.mat", "synthetic.json"]
    labels = nyu_files.read_annotation(folder / "train" / nyu_files.ANNOTATION)
    assert labels.uvd.shape == (70, 36, 3) and np.isfinite(labels.xyz).all() and labels.made_from == "synthetic"
    from_center = np.abs(labels.xyz - labels.xyz[:, CENTER_JOINT, None])
    assert 150 < from_center.max() < 260
    depth = nyu_files.read_nyu_depth(folder / "train" / frame_name(69))
    assert depth.shape == (480, 640) and (depth == 0).mean() > 0.5
    assert "70 train and 3 test frames (synthetic, seed 0) in NYU's format" in done.out


def test_raw_images_are_solid(made: dict[str, Made]) -> None:
    """The hand has no grid of holes where the crop picks every other pixel."""
    for i in range(5):
        seen = (nyu_files.read_nyu_depth(made["raw"].folder / "train" / frame_name(i)) > 0).astype(np.uint8)
        closed = cv2.morphologyEx(seen, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        assert (closed > seen).sum() < 0.03 * seen.sum()


def test_raw_keeps_what_is_there(tmp_path: Path) -> None:
    """The same again is kept; fewer frames leave none of the others behind; without labels nothing is whole."""
    run_tool("make_synthetic", *raw(tmp_path))
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "train").iterdir()}
    assert "exist already" in run_tool("make_synthetic", *raw(tmp_path)).out
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "train").iterdir()} == before
    run_tool("make_synthetic", *raw(tmp_path, train=2))
    assert len(names(tmp_path / "train")) == 4
    (tmp_path / "train" / nyu_files.ANNOTATION).unlink()
    run_tool("make_synthetic", *raw(tmp_path, train=2))
    assert len(nyu_files.read_annotation(tmp_path / "train" / nyu_files.ANNOTATION)) == 2


def test_raw_leaves_real_data_alone(tmp_path: Path) -> None:
    """A folder that this tool did not make is not written to without --force."""
    (tmp_path / "train").mkdir()
    (tmp_path / "train" / frame_name(0)).write_text("a real frame")
    error = run_tool("make_synthetic", *raw(tmp_path), status=1).err
    assert error.count("\n") == 1 and "did not make" in error
    assert (tmp_path / "train" / frame_name(0)).read_text() == "a real frame"
    run_tool("make_synthetic", *raw(tmp_path, "--force"))


def test_raw_workers_change_no_byte(made: dict[str, Made], tmp_path: Path) -> None:
    """Images of two processes are equal to those of one, and so are the labels."""
    assert run_tool("make_synthetic", *raw(tmp_path, train=70)[:-1], "2").err == ""
    for name in (frame_name(0), frame_name(69)):
        assert (made["raw"].folder / "train" / name).read_bytes() == (tmp_path / "train" / name).read_bytes()
    a, b = (
        nyu_files.read_annotation(folder / "train" / nyu_files.ANNOTATION) for folder in (made["raw"].folder, tmp_path)
    )
    np.testing.assert_array_equal(a.xyz, b.xyz)


def test_places(tmp_path: Path) -> None:
    """What a locator learns from, in files that a data layer reads; recipes are for hands."""
    out = str(tmp_path / "places")
    done = run_tool("make_synthetic", "--places", "--out", out, "--train", "5", "--test", "3", "--workers", "1")
    assert done.out.startswith(f"{out}: 5 train and 3 test places (synthetic, seed 0); made 8 of them in")
    with h5py.File(f"{out}/train_000.h5") as file:
        assert {name: file[name].shape for name in file} == {
            "depth": (5, 1, 64, 64), "hand": (5,), "offset": (5, 3), "near": (5, 3), "index": (5,)
        }  # fmt: skip
    done = run_tool("make_synthetic", "--places", "--recipe", "cameras", status=2)
    assert "--recipe applies only to hands" in done.err


def test_another_body_is_left_alone(tmp_path: Path) -> None:
    """Its frames are replaced with --force alone."""
    body = ["--body", str(NYU_HAND.parents[1] / "body" / "arm_prior.prototxt")]
    run_tool("make_synthetic", *arguments(tmp_path, train=10))
    before = (tmp_path / "train_000.h5").read_bytes()
    done = run_tool("make_synthetic", *arguments(tmp_path, *body, train=10), status=1)
    expected = "train_000.h5: holds frames of nyu.prototxt, expected frames of arm.prototxt; choose another folder"
    assert expected in done.err
    assert (tmp_path / "train_000.h5").read_bytes() == before
    run_tool("make_synthetic", *arguments(tmp_path, *body, "--force", train=10))
    assert (tmp_path / "train_000.h5").read_bytes() != before
