"""tools/fit_pose.py: joint angles for a text file of joints, or for a list of HDF5 files."""

import re
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
from tests.support.running import refusal, run_tool
from tests.tools.conftest import mistakes_of

SKELETON = skeletons.load()
FRAMES = 5
FILES = ["part_0.h5", "part_1.h5"]


@pytest.fixture(scope="module")
def inputs():
    prior = prior_file.load().but(scale_std=0, bone_std=0)
    return BodySampler(prior).draw(np.random.default_rng(2), FRAMES).inputs


@pytest.fixture
def joints(inputs, here):
    """Write the 14 joints of hands 800 mm away to xyz.txt and uvd.txt, and return them in mm."""
    joints = kinematics_of(SKELETON).joints(inputs)[:, EVALUATION_JOINTS]
    xyz = joints * CUBE_MM / 2 + (20, -30, 800)
    np.savetxt("xyz.txt", xyz.reshape(FRAMES, -1), fmt="%.6f")
    np.savetxt("uvd.txt", NYU.project(xyz).reshape(FRAMES, -1), fmt="%.6f")
    return xyz


@pytest.fixture
def data(inputs, here):
    """Write data/train.txt and its two files with depth and joints."""
    Path("data").mkdir()
    rows = kinematics_of(SKELETON).joints(inputs).reshape(FRAMES, 93).clip(-1, 1)
    for name, some in zip(FILES, (rows[:2], rows[2:])):
        write_hdf5(f"data/{name}", joint=some, depth=np.zeros((len(some), 1, 4, 4)))
    Path("data/train.txt").write_text("".join(f"data/{name}\n" for name in FILES))
    return rows


def placed(path):
    """Return the 14 joints in mm for the angles of a file."""
    with h5py.File(path) as file:
        half, center = file["half_cube"][...][:, None, None], file["center"][...][:, None]
        return (
            kinematics_of(SKELETON).joints(file["dof"][...])[:, EVALUATION_JOINTS] * half + center
        )


@pytest.mark.parametrize("fmt", ["xyz", "uvd"])
def test_the_joints_of_a_text_file(joints, tmp_path, fmt):
    """With the written angles the model's joints are at the given positions; without --out
    nothing is written.
    """
    before = sorted(tmp_path.iterdir())
    out = run_tool(f"fit_pose {fmt}.txt --format {fmt}").out
    assert sorted(tmp_path.iterdir()) == before
    figures = (
        r"5 frames in \d+ s: residual 0.000\d mm \(mean over joints\), 0.000\d median frame, 0.000\d worst frame; "
        r"0.00% of the frames have an angle outside its limits\n"
    )
    assert re.fullmatch(figures, out)
    again = run_tool(f"fit_pose {fmt}.txt --format {fmt} --out new/angles.h5").out
    assert again.partition(":")[2] == out.partition(":")[2]
    assert placed("new/angles.h5") == pytest.approx(joints, abs=0.01)
    with h5py.File("new/angles.h5") as file:
        assert (file["dof"].shape, file["residual_mm"].shape) == ((FRAMES, 47), (FRAMES, 14))
        assert file["index"][...].tolist() == [0, 1, 2, 3, 4]


def test_some_of_the_frames(joints):
    """--frames selects evenly spaced frames, including the first and the last, and stores
    their indices.
    """
    run_tool("fit_pose uvd.txt --frames 3 --out angles.h5")
    with h5py.File("angles.h5") as file:
        assert file["index"][...].tolist() == [0, 2, 4]
    assert placed("angles.h5") == pytest.approx(joints[::2], abs=0.01)


def figures_of(options):
    """The residual in mm and the percentage of the frames with an angle outside its limits
    that a run prints.
    """
    out = run_tool(f"fit_pose {options}").out
    return float(re.search(r"residual (\S+) mm", out)[1]), float(
        re.search(r"(\S+)% of the frames", out)[1]
    )


def test_the_swarm(joints):
    """--swarm, the paper's method, finds a coarse pose within the limits with few particles."""
    options = "--swarm --particles 16 --generations 30 --out angles.h5"
    residual, broken = figures_of(f"uvd.txt {options}")
    assert 5 < residual < 80 and broken == 0
    assert np.abs(placed("angles.h5") - joints).mean() < 60


def test_limits_and_ridge(joints):
    """For a hand 1.3 times as large, --no-limits exceeds the limits and --ridge
    increases the residual.
    """
    middle = joints[:2].mean(axis=1, keepdims=True)
    large = middle + 1.3 * (joints[:2] - middle)
    np.savetxt("large.txt", large.reshape(2, -1))
    command = "large.txt --format xyz"
    figures = [figures_of(f"{command} {more}") for more in ("", "--no-limits", "--ridge 1")]
    residuals, broken = zip(*figures)
    assert broken[0] == broken[2] == 0 < broken[1]
    assert residuals[1] < residuals[0] < residuals[2]


def test_another_hand(joints, tmp_path):
    """--skeleton names a file like prototxt/hand/nyu.prototxt."""
    text = skeletons.NYU_HAND.read_text().replace("length: 0.307286", "length: 0.5")
    (tmp_path / "longer.prototxt").write_text(text)
    assert figures_of("uvd.txt --skeleton longer.prototxt")[0] > 1


def test_the_files_of_a_list(data, tmp_path):
    """Each file gets a file of angles that refers to its data, and a list of them; a second run
    keeps the files.
    """
    done = run_tool("fit_pose data/train.txt --out angles")
    assert re.match(r"5 frames in \d+ s: residual 0\.00\d\d mm", done.out) and done.err == ""
    assert (tmp_path / "angles" / "train.txt").read_text() == "angles/part_0.h5\nangles/part_1.h5\n"
    for name, count in zip(FILES, (2, 3)):
        dof, depth = File(Path("angles", name), ("dof", "depth")).datasets
        assert (dof.shape, depth.shape) == ((count, 47), (count, 1, 4, 4))
    times = [(tmp_path / "angles" / name).stat().st_mtime_ns for name in FILES]
    again = run_tool("fit_pose data/train.txt --out angles")
    assert again.out.partition(": ")[2] == done.out.partition(": ")[2]
    assert [(tmp_path / "angles" / name).stat().st_mtime_ns for name in FILES] == times


# ----------------------------------------------------------------------------------------- mistakes


@mistakes_of("fit_pose")
def test_mistakes(joints, data, tmp_path, argv, message):
    """Errors are one line each, and no file is changed."""
    for name, text in {
        "words.txt": "some words\n",
        "train.txt": Path("data/train.txt").read_text(),
        "nyu.prototxt": skeletons.NYU_HAND.read_text(),
        "two.prototxt": 'name: "two" joint { name: "a" } joint { name: "b" parent: "a" }',
    }.items():
        (tmp_path / name).write_text(text)
    assert refusal(f"fit_pose {argv}").startswith(message)


@pytest.mark.parametrize("name", [*FILES, "train.txt"])
def test_other_data_are_not_replaced(data, name):
    Path("angles").mkdir()
    Path("angles", name).write_text("notes")
    line = refusal("fit_pose data/train.txt --out angles")
    assert re.match(
        rf"angles/{name}: .*companion of .*; move .* away, or choose another --out$", line
    )
