"""tools/fit_pose.py: joint angles for a text file of joints, or for a list of HDF5 files."""

import re
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from handpose.body.nyu import CUBE_MM, EVALUATION_JOINTS
from handpose.frames.cameras import NYU
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from netlib.files.hdf5 import File
from tests.support.hdf5_files import write_hdf5
from tests.support.running import run_tool

SKELETON = skeletons.load()
FRAMES = 5
FILES = ["part_0.h5", "part_1.h5"]


@pytest.fixture(scope="module")
def inputs():
    """Poses of hands with the packaged bones."""
    prior = prior_file.load().but(scale_std=0, bone_std=0)
    return BodySampler(prior).draw(np.random.default_rng(2), FRAMES).inputs


@pytest.fixture
def joints(inputs, tmp_path, monkeypatch):
    """Write the 14 joints of hands 800 mm away to xyz.txt and uvd.txt, and return them in mm."""
    monkeypatch.chdir(tmp_path)
    xyz = kinematics_of(SKELETON).joints(inputs)[:, EVALUATION_JOINTS] * CUBE_MM / 2 + (20, -30, 800)
    np.savetxt("xyz.txt", xyz.reshape(FRAMES, -1), fmt="%.6f")
    np.savetxt("uvd.txt", NYU.project(xyz).reshape(FRAMES, -1), fmt="%.6f")
    return xyz


@pytest.fixture
def data(inputs, tmp_path, monkeypatch):
    """Write data/train.txt and its two files with depth and joints."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    rows = kinematics_of(SKELETON).joints(inputs).reshape(FRAMES, 93).clip(-1, 1)
    for name, some in zip(FILES, (rows[:2], rows[2:])):
        write_hdf5(f"data/{name}", joint=some, depth=np.zeros((len(some), 1, 4, 4)))
    (tmp_path / "data" / "train.txt").write_text("".join(f"data/{name}\n" for name in FILES))
    return rows


def mistake(*arguments):
    """Return the one line that an error prints."""
    lines = run_tool("fit_pose", *arguments, status=1).err.splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def placed(path):
    """Return the 14 joints in mm for the angles of a file."""
    with h5py.File(path) as file:
        half, center = file["half_cube"][...][:, None, None], file["center"][...][:, None]
        return kinematics_of(SKELETON).joints(file["dof"][...])[:, EVALUATION_JOINTS] * half + center


# ------------------------------------------------------------------------------------------- text files


@pytest.mark.parametrize("fmt", ["xyz", "uvd"])
def test_the_joints_of_a_text_file(joints, fmt):
    """With the written angles the model's joints are at the given positions, and the residual is printed."""
    done = run_tool("fit_pose", f"{fmt}.txt", "--format", fmt, "--out", "new/angles.h5")
    figures = (
        r"5 frames in \d+ s: residual 0.000\d mm \(mean over joints\), 0.000\d median frame, 0.000\d worst frame; "
        r"0.00% of the frames have an angle outside its limits\n"
    )
    assert re.fullmatch(figures, done.out)
    assert placed("new/angles.h5") == pytest.approx(joints, abs=0.01)
    with h5py.File("new/angles.h5") as file:
        assert (file["dof"].shape, file["residual_mm"].shape) == ((FRAMES, 47), (FRAMES, 14))
        assert file["index"][...].tolist() == [0, 1, 2, 3, 4]


def test_without_out_only_the_figures_are_told(joints, tmp_path):
    """Without --out only the residuals are printed."""
    before = sorted(tmp_path.iterdir())
    assert run_tool("fit_pose", "uvd.txt").out.startswith("5 frames in ")
    assert sorted(tmp_path.iterdir()) == before


def test_some_of_the_frames(joints):
    """--frames selects evenly spaced frames, including the first and the last, and stores their indices."""
    run_tool("fit_pose", "uvd.txt", "--frames", "3", "--out", "angles.h5")
    with h5py.File("angles.h5") as file:
        assert file["index"][...].tolist() == [0, 2, 4]
    assert placed("angles.h5") == pytest.approx(joints[::2], abs=0.01)


def test_the_swarm(joints):
    """--swarm, the paper's method, finds a coarse pose within the limits with few particles."""
    done = run_tool("fit_pose", "uvd.txt", "--swarm", "--particles", "16", "--generations", "30", "--out", "angles.h5")
    out = done.out
    assert 5 < float(re.search(r"residual (\S+) mm", out)[1]) < 80
    assert "0.00% of the frames" in out
    assert np.abs(placed("angles.h5") - joints).mean() < 60


def test_limits_and_ridge(joints):
    """For a hand 1.3 times as large, --no-limits exceeds the limits and --ridge increases the residual."""
    large = joints.mean(axis=1, keepdims=True) + 1.3 * (joints - joints.mean(axis=1, keepdims=True))
    np.savetxt("large.txt", large.reshape(FRAMES, -1))
    residuals, broken = [], []
    for options in ([], ["--no-limits"], ["--ridge", "1"]):
        out = run_tool("fit_pose", "large.txt", "--format", "xyz", *options).out
        residuals.append(float(re.search(r"residual (\S+) mm", out)[1]))
        broken.append(float(re.search(r"(\S+)% of the frames", out)[1]))
    assert broken[0] == broken[2] == 0 < broken[1]
    assert residuals[1] < residuals[0] < residuals[2]


def test_another_hand(joints, tmp_path):
    """--skeleton names a file like prototxt/hand/nyu.prototxt."""
    text = skeletons.NYU_HAND.read_text().replace("length: 0.307286", "length: 0.5")
    (tmp_path / "longer.prototxt").write_text(text)
    done = run_tool("fit_pose", "uvd.txt", "--skeleton", "longer.prototxt")
    assert float(re.search(r"residual (\S+) mm", done.out)[1]) > 1


# ------------------------------------------------------------------------------------------------ lists


def test_the_files_of_a_list(data, tmp_path):
    """Each file gets a file of angles that refers to its data, and a list of them that can be used for training."""
    captured = run_tool("fit_pose", "data/train.txt", "--out", "angles")
    assert captured.out.startswith("5 frames in ")
    assert captured.err.splitlines()[1].startswith("2 of 2: angles/part_1.h5, 0.0")
    assert (tmp_path / "angles" / "train.txt").read_text() == "angles/part_0.h5\nangles/part_1.h5\n"
    found = []
    for name in FILES:
        dof, depth = File(Path("angles", name), ("dof", "depth")).datasets
        assert depth.shape == (dof.shape[0], 1, 4, 4)
        found.append(kinematics_of(SKELETON).joints(dof[:]))
    found = np.concatenate(found).reshape(FRAMES, 93)
    assert found[np.abs(data) < 1] == pytest.approx(data[np.abs(data) < 1], abs=1e-4)


def test_a_second_run_keeps_what_is_there(data, tmp_path):
    """A second run keeps the files and prints the same residuals."""
    figures, made = [], []
    for _ in range(2):
        figures.append(run_tool("fit_pose", "data/train.txt", "--out", "angles").out.split(": ")[1])
        made.append([(tmp_path / "angles" / name).stat().st_mtime_ns for name in FILES])
    assert figures[0] == figures[1] and made[0] == made[1]


def test_the_data_are_not_written_over(data, tmp_path):
    """Writing the angles to the folder of the data raises an error."""
    before = (tmp_path / "data" / FILES[0]).read_bytes()
    shutil.copy("data/train.txt", "train.txt")
    line = mistake("train.txt", "--out", "data")
    assert line == "data/part_0.h5: would replace the data themselves; choose another --out"
    assert (tmp_path / "data" / FILES[0]).read_bytes() == before


@pytest.mark.parametrize("name", [*FILES, "train.txt"])
def test_other_data_are_not_replaced(data, tmp_path, name):
    """Other data sets, lists and files in the output folder are not replaced."""
    run_tool("fit_pose", "data/train.txt", "--out", "angles")
    place = tmp_path / "angles" / name
    contents = ["notes"] if name == "train.txt" else ["notes", (tmp_path / "data" / name).read_bytes()]
    for content in contents:
        place.write_bytes(content.encode() if isinstance(content, str) else content)
        before = {path: path.read_bytes() for path in (tmp_path / "angles").iterdir()}
        line = mistake("data/train.txt", "--out", "angles")
        assert re.match(rf"angles/{name}: .*companion of .*; move .* away, or choose another --out$", line)
        assert {path: path.read_bytes() for path in (tmp_path / "angles").iterdir()} == before


# --------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["gone.txt"], "gone.txt: cannot read the joints: No such file or directory"),
        (["."], ".: cannot read the joints: Is a directory"),
        (["empty.txt"], "empty.txt: empty, expected the numbers of a frame on each line"),
        (["short.txt"], "short.txt:1: found 3 numbers, expected 42 = 14 joints x 3"),
        (["xyz.txt"], "xyz.txt:1: found a joint at depth"),
        (["typo.txt"], "typo.txt:1:5: found '3,', expected a number of px or mm"),
        (["words.txt", "--out", "o"], "words.txt:1:1: found 'some', expected a number of px or mm"),
        (["commas.txt"], "commas.txt:1:1: found '1,2,3', expected a number of px or mm"),
        (["header.txt", "--swarm"], "header.txt:1:1: found '#', expected a number of px or mm"),
        (["gone_h5.txt", "--out", "o"], "gone_h5.txt: names 'gone.h5', which does not exist"),
        (["data/train.txt"], "data/train.txt: a list of HDF5 files needs --out FOLDER for their angles"),
        (["data/train.txt", "--out", "o", "--swarm"], "data/train.txt: a list of HDF5 files; --swarm, "),
        (["data/train.txt", "--out", "o", "--frames", "1"], "data/train.txt: a list of HDF5 files; --swarm, "),
        (["data/train.txt", "--out", "o", "--format", "xyz"], "data/train.txt: a list of HDF5 files; --swarm, "),
        (["data/train.txt", "--out", "empty.txt"], "empty.txt: is a file; expected a folder"),
        (["nothdf5.txt", "--out", "o"], "short.txt: cannot read the HDF5 file: "),
        (["uvd.txt", "--skeleton", "gone.prototxt"], "gone.prototxt: cannot read"),
        (["uvd.txt", "--skeleton", "two.prototxt"], "skeleton 'two' has 2 joints, expected the 31 of NYU's hand"),
        (["uvd.txt", "--out", "empty.txt/angles.h5"], "empty.txt: is a file; expected a folder"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_mistakes(joints, data, tmp_path, arguments, message):
    """Errors are one line each."""
    for name, text in {
        "empty.txt": "",
        "short.txt": "1 2 3\n",
        "typo.txt": "1 2 3, 4\n",
        "words.txt": "some words\n",
        "commas.txt": "1,2,3\n",
        "header.txt": "# u v d\n1 2 3\n",
        "gone_h5.txt": "gone.h5\n",
        "nothdf5.txt": "short.txt\n",
        "two.prototxt": 'name: "two" joint { name: "a" } joint { name: "b" parent: "a" }',
    }.items():
        (tmp_path / name).write_text(text)
    np.savetxt("xyz.txt", -joints.reshape(FRAMES, -1))
    assert mistake(*arguments).startswith(message)


@pytest.mark.parametrize(
    "options",
    [
        ["--ridge", "-1"],
        ["--ridge", "nan"],
        ["--starts", "0"],
        ["--frames", "0"],
        ["--format", "uvz"],
        ["--swarm", "--no-limits"],
        ["--swarm", "--ridge", "1"],
        ["--swarm", "--particles", "0"],
        ["--particles", "64"],
        ["--generations", "64"],
        ["--swarm", "--starts", "4"],
    ],
    ids=" ".join,
)
def test_usage(options):
    """Wrong usage gives argparse's message and status 2."""
    run_tool("fit_pose", "uvd.txt", *options, status=2)
