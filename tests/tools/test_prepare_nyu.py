"""tools/prepare_nyu.py"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import scipy.io

from handpose.body.nyu import ANNOTATION_OF_JOINT, frame_name
from handpose.datasets import nyu_files, parts
from handpose.frames.cameras import NYU
from handpose.frames.crops import crop, window
from handpose.frames.images import pack_depth
from tests.support.nyu_data_set import write_annotation, write_data_set
from tests.support.running import Done, run_python, run_tool

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "data" / "nyu"
needs_real = pytest.mark.skipif(not SHARED.is_dir(), reason="needs real NYU frames")


@pytest.fixture(scope="session")
def raw(tmp_path_factory) -> Path:
    """30 training and 20 test frames in NYU's format."""
    return write_data_set(tmp_path_factory.mktemp("raw"), {"train": 30, "test": 20})


@pytest.fixture
def root(raw, tmp_path) -> Path:
    """A copy of the frames that a test may damage."""
    shutil.copytree(raw, tmp_path / "root")
    return tmp_path / "root"


@pytest.fixture
def small(monkeypatch) -> None:
    """Set the number of frames per file to 12."""
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 12)


def prepare(root: Path, *more: object, status: int = 0) -> Done:
    return run_tool("prepare_nyu", root, "--out", root.parent / "out", "--workers", "2", *more, status=status)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write_labels(folder: Path, uvd: np.ndarray, made_from: str = "NYU") -> None:
    """Write the labels ``uvd`` (N, 36, 3)."""
    folder.mkdir(parents=True, exist_ok=True)
    write_annotation(folder / nyu_files.ANNOTATION, NYU.unproject(uvd), made_from)


def hand(count: int) -> np.ndarray:
    """Return annotations at the image centre, 800 mm away."""
    return np.tile([320.0, 240.0, 800.0], (count, 36, 1)) + np.random.default_rng(0).normal(0, 5, (count, 36, 3))


def write_frame(path: Path, depth: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pack_depth(depth))


# ------------------------------------------------------------------------------------------- written files


def test_raw_equals_direct(tmp_path):
    """Frames converted through NYU's format equal those written directly, with depth to 0.5 mm."""
    count = ["--train", "70", "--test", "10", "--workers", "1"]
    write_data_set(tmp_path / "root", {"train": 70, "test": 10})
    run_tool("make_synthetic", "--out", tmp_path / "direct", *count)
    out = prepare(tmp_path / "root").out
    for split, frames in (("train", 70), ("test", 10)):
        with (
            h5py.File(tmp_path / "direct" / f"{split}_000.h5") as a,
            h5py.File(tmp_path / "out" / f"{split}_000.h5") as b,
        ):
            assert sorted(b) == sorted(set(a) - {"dof", "bones"}) and b.attrs["made_from"] == "synthetic"
            for name in ("index", "center", "center_uvd", "half_cube"):
                np.testing.assert_array_equal(a[name][:], b[name][:], name)
            np.testing.assert_allclose(b["joint"][:], a["joint"][:], rtol=0, atol=1e-6)
            assert b["depth"].dtype == np.float32 and b["depth"].chunks is None and b["depth"].shape[0] == frames
            picked = window(a["center_uvd"][:].astype(float), 300)
            # pixels outside the image are not stored in a file
            inside = ((picked.rows >= 0)[:, :, None] & (picked.columns >= 0)[:, None])[:, None]
            difference = np.abs(a["depth"][:] - b["depth"][:]) * 150
            assert difference[inside].max() <= 0.5 + 1e-4  # mm, as the images hold integers
            assert 0.1 < difference[(np.abs(a["depth"][:]) < 1) & inside].mean() < 0.4
    assert "train: 70 frames (synthetic), none bad" in out
    assert "mm from the centre (annotated joint 34), cube 300 mm" in out


@needs_real
def test_the_published_crop(tmp_path):
    """The crop of the first real test frame equals the one published by the paper's authors in every pixel."""
    folder = tmp_path / "root" / "dataset" / "test"
    uvd = np.load(SHARED / "test_joint_uvd.npz")["joint_uvd"][:1].astype(float)
    write_labels(folder, uvd)
    shutil.copy(SHARED / "depth_1_0000001.png", folder)
    prepare(tmp_path / "root", "--splits", "test", "--strict")
    published = cv2.imread(str(SHARED / "crops" / "0.png"), cv2.IMREAD_GRAYSCALE)
    with h5py.File(tmp_path / "out" / "test_000.h5") as file:
        assert file.attrs["made_from"] == "NYU"
        np.testing.assert_array_equal(np.rint((file["depth"][0, 0] + 1) / 2 * 255), published)
        mm = NYU.unproject(uvd)[0]
        expected = np.clip((mm[list(ANNOTATION_OF_JOINT)] - mm[34]) / 150, -1, 1).reshape(-1)
        np.testing.assert_allclose(file["joint"][0], expected, atol=1e-6)
        np.testing.assert_allclose(file["center"][0], mm[34], rtol=1e-6)
        palm = file["joint"][0].reshape(31, 3)[24]
        assert palm[1] > 0 and uvd[0, 32, 1] < uvd[0, 34, 1]  # higher in the image is larger y
    assert (tmp_path / "out" / "test.txt").read_text() == f"{tmp_path}/out/test_000.h5\n"


def test_second_subject(tmp_path):
    """The cube is 261 mm for test frames from 2440 on, and 300 mm for all others."""
    for split in ("train", "test"):
        write_labels(tmp_path / split, hand(2442))
        frames = nyu_files.read_split(tmp_path, split)
        cubes = frames.cube_mm[[0, 2439, 2440, 2441]]
        np.testing.assert_allclose(cubes, [300, 300, 261, 261] if split == "test" else 300)


@pytest.mark.parametrize("kind", ["txt", "npy", "npz"])
def test_other_centres(root, kind):
    """--center FILE crops around the centres of a file and reports it."""
    centers = np.tile([300.0, 200.0, 700.0], (20, 1)) + np.arange(20)[:, None]
    path = root.parent / f"centers_test.{kind}"
    if kind == "txt":
        path.write_text("".join(f"{u} {v} {d}\n" for u, v, d in centers))
    elif kind == "npy":
        np.save(path, centers)
    else:
        np.savez(path, center_uvd=centers)
    centre = ["--center", str(path).replace("test.", "{split}.")]
    done = prepare(root, "--splits", "test", *centre, status=None)
    with h5py.File(root.parent / "out" / "test_000.h5") as file:
        some = file["index"][:]
        np.testing.assert_allclose(file["center_uvd"][:], centers[some])
        depth = nyu_files.read_nyu_depth(root / "test" / frame_name(int(some[-1])))
        np.testing.assert_array_equal(file["depth"][-1, 0], crop(depth, centers[some[-1]], 300))
        labels = nyu_files.read_annotation(root / "test" / nyu_files.ANNOTATION).xyz[some][:, list(ANNOTATION_OF_JOINT)]
        expected = (labels - NYU.unproject(centers[some])[:, None]) / 150
        np.testing.assert_allclose(file["joint"][:].reshape(-1, 31, 3), np.clip(expected, -1, 1), atol=1e-5)
    assert f"centres of centers_test.{kind}" in done.out


# ------------------------------------------------------------------------------------------------ the run


def modification_times(out: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in out.glob("*.h5")}


def test_resume(root, small):
    """A second run keeps all files; after a change of one frame only its file is written again."""
    prepare(root)
    out = root.parent / "out"
    times = modification_times(out)
    assert len(times) == 5 and (out / "train.txt").read_text().count("\n") == 3
    assert "all files kept" in prepare(root).out and modification_times(out) == times
    write_frame(root / "train" / frame_name(13), np.full((480, 640), 800))
    assert "made 12 frames" in prepare(root).out
    assert {name for name, time in modification_times(out).items() if time != times[name]} == {"train_001.h5"}


def test_workers_change_no_byte(root):
    """Files of one worker and of three are equal byte for byte."""
    for workers in "13":
        run_tool("prepare_nyu", root, "--out", root.parent / workers, "--workers", workers)
    assert (root.parent / "1" / "train_000.h5").read_bytes() == (root.parent / "3" / "train_000.h5").read_bytes()


def break_frames(root: Path) -> None:
    """Damage frames 2 to 7 of the training set, each in another way."""
    at = [root / "train" / frame_name(i) for i in range(30)]
    at[2].unlink()
    at[3].write_bytes(at[3].read_bytes()[:-100])
    write_frame(at[4], np.full((240, 320), 800))
    assert cv2.imwrite(str(at[5]), np.full((480, 640), 800, np.uint16))
    write_frame(at[6], np.full((480, 640), 3000))
    at[7].write_bytes(b"")


KINDS = ("no such file", "truncated, damaged or no PNG", "wrong size", "found uint16", "no depth around the hand")


def test_bad_frames(root, small):
    """Bad frames are named, counted and left out in every run; the other frames are complete."""
    break_frames(root)
    for made in ("made 44 frames", "all files kept"):
        out, err = prepare(root)[1:]
        assert made in out and "train: 24 frames (synthetic), 6 bad frames left out: 1 no depth" in out
        assert "2 truncated" in out and "2 wrong size" in out
        assert "warning: " in err and "1 of 30 depth frames are missing, the first is depth_1_0000003.png" in err
        for i in range(2, 8):
            assert f"train frame {i}: {root}/train/{frame_name(i)}: " in err
    folder = root.parent / "out"
    assert (folder / "bad_train.txt").read_text().count("\n") == 6 and not (folder / "bad_test.txt").exists()
    with h5py.File(folder / "train_000.h5") as file:
        np.testing.assert_array_equal(file["index"], [0, 1, 8, 9, 10, 11])
        assert all(len(file[name]) == 6 for name in file)
        depth = crop(nyu_files.read_nyu_depth(root / "train" / frame_name(9)), file["center_uvd"][3].astype(float), 300)
        np.testing.assert_array_equal(file["depth"][3, 0], depth)
    assert not [name for name in names(folder) if name.endswith(".tmp")]


def test_mended_frames_are_taken_in(root, raw, small):
    """When a missing frame is added, the next run writes its file again."""
    break_frames(root)
    prepare(root)
    shutil.copy(raw / "train" / frame_name(2), root / "train")
    assert "train: 25 frames" in prepare(root).out


@pytest.mark.parametrize("frame", range(2, 8))
def test_strict(root, raw, small, frame):
    """--strict stops at the first bad frame with a one-line error and keeps only complete files."""
    break_frames(root)
    for i in range(2, frame):
        shutil.copy(raw / "train" / frame_name(i), root / "train")
    done = prepare(root, "--strict", "--splits", "test", "train", status=1)
    error = [line for line in done.err.splitlines() if not line.startswith("warning: ")]
    assert len(error) == 1 and frame_name(frame) in error[0] and any(kind in error[0] for kind in KINDS)
    assert "train_000.h5" not in names(root.parent / "out") and "train.txt" not in names(root.parent / "out")


def test_nothing_usable(root, small):
    """A split without a usable frame gives an error and no list."""
    for i in range(20):
        write_frame(root / "test" / frame_name(i), np.zeros((480, 640)))
    error = prepare(root, "--splits", "test", status=1).err
    assert "none of the 20 test frames can be used" in error and "10 more bad frames, see" in error
    assert "test.txt" not in names(root.parent / "out")


def test_file_without_good_frames_is_not_listed(root, small):
    """A file without usable frames is not listed, because HDF5Data requires rows in every file."""
    for i in range(12):
        (root / "train" / frame_name(i)).write_bytes(b"")
    for _ in range(2):
        prepare(root, "--splits", "train")
        listed = (root.parent / "out" / "train.txt").read_text().splitlines()
        assert [Path(line).name for line in listed] == ["train_001.h5", "train_002.h5"]


def test_labels_that_are_no_numbers(root):
    """A frame with NaN in its annotation is a bad frame."""
    labels = nyu_files.read_annotation(root / "test" / nyu_files.ANNOTATION)
    labels.xyz[4, 0] = np.nan
    write_annotation(root / "test" / nyu_files.ANNOTATION, labels.xyz, "synthetic")
    assert "test frame 4: " in prepare(root, "--splits", "test").err


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_interrupted(root):
    """SIGTERM leaves only complete files."""
    out = root.parent / "out"
    run = run_python("-c", INTERRUPTED, root, "--out", out, "--splits", "test", status=143)
    assert run[1:] == ("", "stopped; whole files are kept, and the next run continues after them\n")
    assert not names(out)


INTERRUPTED = """
import os, signal, sys, threading
from pathlib import Path
from handpose.datasets import nyu_files
from tools import prepare_nyu

def read(path):  # in several threads
    if list(Path(sys.argv[3]).glob(".*.tmp")) and first.acquire(blocking=False):
        os.kill(os.getpid(), signal.SIGTERM)
    return original(path)

first, original, nyu_files.read_nyu_depth = threading.Lock(), nyu_files.read_nyu_depth, read
sys.exit(prepare_nyu.main(sys.argv[1:]))
"""


def test_leaves_foreign_files_alone(root):
    """Data of another origin are not replaced without --force."""
    out = root.parent / "out"
    out.mkdir()
    with h5py.File(out / "test_000.h5", "w") as file:
        file.attrs["made_from"] = "my camera"
    assert "made from my camera" in prepare(root, status=1).err and names(out) == ["test_000.h5"]
    with h5py.File(out / "test_000.h5", "w") as file:
        file.attrs["made_from"] = "synthetic"
    line = "test_000.h5: holds rendered frames (make_synthetic); choose another --out, or use --force to replace it\n"
    assert prepare(root, status=1).err.endswith(line) and names(out) == ["test_000.h5"]
    (out / "test_000.h5").unlink()
    (out / "train.txt").write_text("precious\n")
    done = prepare(root, status=1)
    assert "train.txt: names 'precious', which is not there" in done.err and names(out) == ["train.txt"]
    (out / "test_000.h5").mkdir()
    done = prepare(root, "--force", status=1)
    assert "test_000.h5: is not a file" in done.err and (out / "train.txt").read_text() == "precious\n"
    (out / "test_000.h5").rmdir()
    prepare(root, "--force")


# ---------------------------------------------------------------------------------------------- --check


def check(root: Path, *more: str) -> list[str]:
    """Return the problems that --check reports.

    If there are none, its last line says so and its exit status is 0; otherwise there is no such line, and it is 1.
    """
    done = run_tool("prepare_nyu", root, "--check", "--out", root / "out", *more, status=None)
    lines = done.err.splitlines()
    assert done.status == (1 if lines else 0) and not (root / "out").exists()
    assert (f"{root}: complete" in done.out) == (not lines)
    return lines


def refused(root: Path, out: Path, *more: str) -> None:
    """Test that the run itself fails with the same lines before it writes anything."""
    lines = check(root, *more)
    done = run_tool("prepare_nyu", root, "--out", out, *more, status=1)
    reported = [line.removeprefix("warning: ") for line in done.err.splitlines()]
    assert reported == lines and not out.exists()


def test_check_whole(raw):
    """A complete directory has no faults."""
    assert check(raw) == []


def test_check_counts(tmp_path):
    """--check reports an incomplete data set; the second test subject alone cannot be prepared."""
    for count, reported in ((2440, "the first of the two test subjects only"), (5812, "the second test subject only"),
                        (100, "100 labelled frames, the whole test set has 8252")):
        write_labels(tmp_path / "test", hand(count))
        write_frame(tmp_path / "test" / frame_name(0), np.full((480, 640), 800))
        lines = check(tmp_path, "--splits", "test")
        assert reported in lines[0] and f"{count - 1} of {count} depth frames are missing" in lines[1]
    write_labels(tmp_path / "test", hand(5812))
    refused(tmp_path, tmp_path / "out", "--splits", "test")


def test_check_missing_subject(tmp_path):
    """Labels without the frames of one subject are reported."""
    write_labels(tmp_path / "test", hand(8252))
    for i in range(2440):
        (tmp_path / "test" / frame_name(i)).touch()
    (line,) = check(tmp_path, "--splits", "test")
    assert "5812 of 8252 depth frames are missing, the first is depth_1_0002441.png" in line
    assert "all of the second test subject's are" in line


@pytest.mark.parametrize(
    ("files", "reported"),
    [
        (["Training/labels.txt", "Training/Depth/a/image_0000.png"], "the ICVL data set; use the command prepare_icvl"),
        (["P0/1/000000_depth.bin", "P1/1/joint.txt"], "looks like the MSRA15 data set"),
        (["test_groundtruth_uvd.txt", "predictions.txt"], "looks like only text files"),
        (["nyu_hand_dataset_v2.zip"], "an archive that is not unpacked (nyu_hand_dataset_v2.zip)"),
        (["train.txt", "train_000.h5"], "prepared already"),
        (["notes.odt"], "does not look like any data set known here"),
        ([], "looks like nothing"),
    ],
)
def test_check_wrong_archive(tmp_path, files, reported):
    """Other data sets are recognised."""
    for name in files:
        path = tmp_path / "root" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (tmp_path / "root").mkdir(exist_ok=True)
    refused(tmp_path / "root", tmp_path / "out")
    lines = check(tmp_path / "root")
    assert len(lines) == 2 and all(reported in line for line in lines)


@pytest.mark.parametrize(("prefix", "reported"), [("synthdepth_1_", "rendered depth"), ("rgb_1_", "colour images"),
                                              ("depth_2_", "camera 2")])
def test_check_wrong_images(root, prefix, reported):
    """Rendered depth, colour images and frames of another camera are distinguished from the real depth."""
    for path in list((root / "test").glob("depth_1_*.png")):
        path.rename(path.with_name(prefix + path.name.removeprefix("depth_1_")))
    refused(root, root.parent / "out")
    (line,) = check(root)
    assert reported in line and "no depth frames such as depth_1_0000001.png" in line


def test_check_places(root):
    """A split in place of the root, a missing split and a missing root are reported."""
    assert all("is itself a split" in line for line in check(root / "train"))
    shutil.rmtree(root / "test")
    (line,) = check(root)
    assert "no folder 'test'; the data set has train and test" in line
    (line,) = check(root.parent / "no")
    assert "no such folder" in line


def damage_labels(path: Path, how: str) -> None:
    joints = nyu_files.read_annotation(path).xyz
    uvd = NYU.project(joints)
    if how == "absent":
        path.unlink()
    elif how == "truncated":
        path.write_bytes(path.read_bytes()[:-1000])
    elif how == "text":
        path.write_text("u v d " * 100)
    elif how == "version 4":
        scipy.io.savemat(path, {"joint_uvd": uvd[0], "joint_xyz": joints[0]}, format="4")
    elif how == "predictions":
        scipy.io.savemat(path, {"pred_joint_uvconf": uvd[None]})
    elif how == "14 joints":
        scipy.io.savemat(path, {"joint_uvd": uvd[None, :, :14], "joint_xyz": joints[None, :, :14]})
    elif how == "y down":
        scipy.io.savemat(path, {"joint_uvd": uvd[None], "joint_xyz": joints[None] * (1, -1, 1)})


@pytest.mark.parametrize(
    ("how", "reported"),
    [
        ("absent", "no such file; it holds the joints"),
        ("truncated", "not a readable MATLAB file, perhaps truncated"),
        ("text", "not a readable MATLAB file"),
        ("version 4", "version 4, or none; expected version 5 or 7.3"),
        ("predictions", "no variable 'joint_uvd'; it has pred_joint_uvconf"),
        ("14 joints", "(1, 20, 14, 3), expected numbers (cameras, frames, 36, 3)"),
        ("y down", "its y axis points down, expected up"),
    ],
)
def test_check_labels(root, how, reported):
    """Each fault of joint_data.mat is reported on one line and stops the run."""
    damage_labels(root / "test" / nyu_files.ANNOTATION, how)
    refused(root, root.parent / "out")
    (line,) = check(root)
    assert reported in line and str(root / "test" / nyu_files.ANNOTATION) in line


def test_labels_of_version_73(root):
    """MATLAB version 7.3 is HDF5 with reversed axes; the first of three cameras is used."""
    path = root / "test" / nyu_files.ANNOTATION
    labels = nyu_files.read_annotation(path)
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in (("joint_uvd", labels.uvd), ("joint_xyz", labels.xyz)):
            file[name] = np.stack([array, array + 1, array + 2]).T
        file["made_from"] = np.array([[ord(c)] for c in "synthetic"], np.uint16)
    again = nyu_files.read_annotation(path)
    np.testing.assert_array_equal(again.uvd, labels.uvd)
    np.testing.assert_array_equal(again.xyz, labels.xyz)
    assert check(root) == []


@pytest.mark.parametrize(
    ("text", "reported"),
    [("1 2\n" * 20, "centers.txt:1: expected 3 numbers, found '1 2'"), ("1 2 3\n" * 19, "expected (20, 3)"),
     ("u v d\n", "centers.txt:1: expected 3 numbers"), (None, "No such file")],
)
def test_wrong_centres(root, text, reported):
    """An invalid file of centres gives a one-line error."""
    path = root.parent / "centers.txt"
    if text is not None:
        path.write_text(text)
    error = prepare(root, "--splits", "test", "--center", str(path), status=1).err
    assert reported in error and error.count("\n") == 1


def test_usage(root):
    """One file of centres cannot serve two splits, and other invalid options are rejected."""
    for wrong in (["--center", "c.txt"], ["--workers", "0"], ["--splits", "val"]):
        assert wrong[0] in prepare(root, *wrong, status=2).err
