"""tools/prepare_nyu.py: the written files, bad frames, signals, and --check"""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.nyu import frame_name
from handpose.datasets import nyu_files, parts
from handpose.frames.crops import window
from tests.support.nyu_data_set import pack_depth, write_data_set
from tests.support.running import Done, run_tool

COUNT = "--train 30 --test 20 --workers 1"


@pytest.fixture(scope="session")
def raw(tmp_path_factory) -> Path:
    """30 training and 20 test frames in NYU's format."""
    return write_data_set(tmp_path_factory.mktemp("raw"), {"train": 30, "test": 20})


@pytest.fixture
def root(raw, tmp_path, monkeypatch) -> Path:
    """A copy of the frames that a test may damage, as if they were the whole data set."""
    monkeypatch.setattr(nyu_files, "TRAIN_FRAMES", 30)
    monkeypatch.setattr(nyu_files, "TEST_FRAMES", 20)
    shutil.copytree(raw, tmp_path / "root")
    return tmp_path / "root"


@pytest.fixture
def small(monkeypatch) -> None:
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 12)


def prepare(root: Path, options: str = "", status: int = 0) -> Done:
    out = root.parent / "out"
    return run_tool(f"prepare_nyu {root} --out {out} --workers 2 {options}", status=status)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# ------------------------------------------------------------------------------------ written files


def test_raw_equals_direct(root, tmp_path):
    """Frames converted through NYU's format equal those written directly, with depth to 0.5 mm."""
    run_tool(f"make_synthetic --out {tmp_path}/direct {COUNT}")
    out = prepare(root).out
    for split in ("train", "test"):
        with (
            h5py.File(tmp_path / f"direct/{split}_000.h5") as a,
            h5py.File(tmp_path / f"out/{split}_000.h5") as b,
        ):
            assert sorted(b) == sorted(set(a) - {"dof", "bones"})
            assert b.attrs["made_from"] == "NYU"
            for name in ("index", "center", "center_uvd", "half_cube"):
                assert_array_equal(a[name][:], b[name][:], name)
            assert_allclose(b["joint"][:], a["joint"][:], rtol=0, atol=1e-6)
            picked = window(a["center_uvd"][:].astype(float), 300)
            rows, columns = picked.rows[:, None, :, None], picked.columns[:, None, None]
            inside = (rows >= 0) & (columns >= 0)  # pixels outside the image are not stored
            off = np.abs(a["depth"][:] - b["depth"][:])[inside]
            assert off.max() * 150 <= 0.5 + 1e-4  # mm, of whole mm
    assert "train: 30 frames (NYU), none bad" in out
    assert "crops about the annotated joint 34, cube 300 mm" in out
    before = (tmp_path / "out" / "train_000.h5").read_bytes()
    prepare(root, "--workers 1 --force")
    assert (tmp_path / "out" / "train_000.h5").read_bytes() == before


def test_other_centres(root):
    """--center FILE crops around the centres of a file and reports it."""
    centers = np.tile([300.0, 200.0, 700.0], (20, 1)) + np.arange(20)[:, None]
    np.savetxt(root.parent / "centers_test.txt", centers)
    done = prepare(root, f"--splits test --center {root.parent}/centers_{{split}}.txt")
    with h5py.File(root.parent / "out" / "test_000.h5") as file:
        assert_allclose(file["center_uvd"][:], centers[file["index"][:]])
    assert "centres of centers_test.txt" in done.out


# ------------------------------------------------------------------------------------------ the run


def test_bad_frames(root, small):
    """Bad frames are named, counted and left out in every run; --strict stops at the
    first, in one line.
    """
    (root / "train" / frame_name(2)).unlink()
    damaged = root / "train" / frame_name(3)
    damaged.write_bytes(damaged.read_bytes()[:-100])
    done = prepare(root, "--strict --splits test train", status=1)
    (error,) = [line for line in done.err.splitlines() if not line.startswith("warning: ")]
    assert frame_name(2) in error
    assert "no such file" in error
    assert names(root.parent / "out") == []
    for made in ("made 48 frames", "all files kept"):
        out, err = prepare(root)[1:]
        assert made in out
        assert "train: 28 frames (NYU), 2 bad frames left out: 1 no such file, 1 truncated" in out
        assert "warning: " in err
        assert f"1 of 30 depth frames are missing, the first is {root}/train/" in err
        for i in (2, 3):
            assert f"train frame {i}: {root}/train/{frame_name(i)}: " in err
    made_files = names(root.parent / "out")
    assert "bad_train.txt" in made_files
    assert "bad_test.txt" not in made_files
    assert not [name for name in made_files if name.endswith(".tmp")]
    with h5py.File(root.parent / "out" / "train_000.h5") as file:
        assert_array_equal(file["index"], [0, 1, *range(4, 12)])
        assert all(len(file[name]) == 10 for name in file)


def test_a_split_without_usable_frames_is_an_error(root, small):
    """No list is written."""
    for i in range(20):
        cv2.imwrite(str(root / "test" / frame_name(i)), pack_depth(np.zeros((480, 640))))
    error = prepare(root, "--splits test", status=1).err
    assert "none of the 20 test frames can be used" in error
    assert "10 more bad frames, see" in error
    assert "test.txt" not in names(root.parent / "out")


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_signal_leaves_whole_files(root, small, monkeypatch):
    original = nyu_files.read_nyu_depth

    def read(path):  # in several threads
        if path.name == frame_name(13):
            os.kill(os.getpid(), signal.SIGTERM)
        return original(path)

    monkeypatch.setattr(nyu_files, "read_nyu_depth", read)
    done = prepare(root, "--splits train", status=143)
    assert done[1:] == (
        "",
        "stopped; whole files are kept, and the next run continues after them\n",
    )
    assert names(root.parent / "out") == ["train_000.h5"]


def test_rendered_frames_are_replaced_with_force_only(root):
    out = root.parent / "out"
    run_tool(f"make_synthetic --out {out} {COUNT}")
    line = "train_000.h5: holds data made from synthetic frames of nyu.prototxt, expected NYU; choose another --out, "
    assert line in prepare(root, status=1).err
    assert len(names(out)) == 4
    prepare(root, "--force")
    with h5py.File(out / "train_000.h5") as file:
        assert file.attrs["made_from"] == "NYU"


# ----------------------------------------------------------------------------------------- mistakes


def test_check(root):
    """--check prints what exists; it prints "complete" and returns 0 only if nothing is missing."""
    done = run_tool(f"prepare_nyu {root} --check --out {root}/out")
    train = f"{root}/train: 30 labelled frames, 30 of their depth frames\n"
    test = f"{root}/test: 20 labelled frames, 20 of their depth frames\n"
    assert done[1:] == (f"{train}{test}{root}: complete\n", "")
    assert not (root / "out").exists()
    (root / "test" / frame_name(3)).unlink()
    done = run_tool(f"prepare_nyu {root} --check --splits test", status=1)
    missing = f"{root}/test: 1 of 20 depth frames are missing, the first is {root}/test/depth_1_0000004.png\n"
    assert done[1:] == (test.replace("20 of", "19 of"), missing)
    (root / "train" / nyu_files.ANNOTATION).unlink()
    problems = run_tool(f"prepare_nyu {root} --check", status=1).err
    assert "joint_data.mat: no such file; it holds the joints" in problems
    assert prepare(root, status=1)[1:] == ("", problems.replace(missing, f"warning: {missing}"))
    assert not (root.parent / "out").exists()
    done = run_tool(f"prepare_nyu {root}/no --check", status=1)
    assert done.err == f"{root}/no: no such folder\n"
