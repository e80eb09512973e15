"""tools/calibrate_hand.py: a skeleton file from annotated frames, for nets and fits."""

import dataclasses
import re

import cv2
import numpy as np
import pytest

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.fit.joints.fit_joints import fit_joints
from handpose.fit.size_calibration import GRID, HandSize
from handpose.frames.cameras import KINECT2
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from tests.handpose.whole_images import ARM_BEHIND, capsules_of, render_image
from tests.support.hdf5_files import write_hdf5, write_joints
from tests.support.running import run_tool
from tools import calibrate_hand

HAND = skeletons.load()


@pytest.fixture(scope="module")
def frames():
    """60 frames of a hand that is 10% smaller than the packaged one and has a longer thumb."""
    bones = 0.9 * HAND.bones * np.where(np.char.startswith(HAND.joint_names, "thumb"), 1.1, 1)
    inputs = BodySampler().draw(np.random.default_rng(3), 60).inputs
    inputs[:, :3] += 0.1 * HAND.initial[:3]
    return np.clip(kinematics_of(HAND).joints(inputs, np.tile(bones, (60, 1))), -1, 1)


@pytest.fixture
def work(tmp_path, monkeypatch, frames):
    """Make a folder with me.h5 the working directory."""
    monkeypatch.chdir(tmp_path)
    write_joints("me.h5", frames, half_cube=np.full(60, 125.0))
    return tmp_path


def test_a_hand(work, frames):
    """The skeleton is in the unit of the frames, names their source, and fits the frames within its limits."""
    _, out, err = run_tool("calibrate_hand", "me.h5", "--out", "me.prototxt", "--percentile", "0")
    assert not err and "wrote me.prototxt in " in out
    hand = skeletons.load(work / "me.prototxt")
    thumb = HAND.joint_names.index("thumb_dip")
    assert hand.name == "me" and hand.bones[thumb] == pytest.approx(0.99 * HAND.bones[thumb], rel=1e-3)
    line = next(line.split() for line in out.splitlines() if line.startswith("thumb_dip "))
    assert line[1:3] == ["38.4", "38.0"]  # mm, before and after calibration
    assert "60 of 60 frames, " in out and "is 125 mm" in out and "thumb_tip_rot_z" in out
    text = (work / "me.prototxt").read_text()
    for fact in ("60 of the 60", "'me.h5'", "31 of 31", "half-cubes of 125 mm", "wrist_left_rot_y"):
        assert fact in text[: text.index("name:")].replace("\n# ", " ")
    seen = np.where((np.abs(frames) >= 1).any(axis=2, keepdims=True), np.nan, frames)
    assert np.nanmean(fit_joints(hand, seen).residuals) * 125 < 0.05
    assert [path.name for path in work.iterdir() if "tmp" in path.name] == []


def test_the_same_frames_give_the_same_file(work):
    """The result is reproducible to the byte and depends on the seed; --force is required to replace a file."""
    command = ["me.h5", "--out", "me.prototxt", "--frames", "30", "--joints", "14", "--half-cube", "150"]
    done = run_tool("calibrate_hand", *command)
    first = (work / "me.prototxt").read_bytes()
    assert b"half-cubes of 150 mm" in first and b"little_tip, little_pip_a, ring_tip" in first
    assert "not determined" in done.out
    assert run_tool("calibrate_hand", *command, "--seed", "1", status=1).err == (
        "me.prototxt: exists already; choose another --out, or replace it with --force\n"
    )
    assert (work / "me.prototxt").read_bytes() == first
    run_tool("calibrate_hand", *command, "--force")
    assert (work / "me.prototxt").read_bytes() == first
    run_tool("calibrate_hand", *command, "--force", "--seed", "1")
    assert (work / "me.prototxt").read_bytes() != first


def test_a_list_without_half_cube_and_an_own_template(work, frames):
    """The files of a list are one set in NYU's unit, and a result can be the next template."""
    write_joints("a.h5", frames[:20])
    write_joints("b.h5", frames[20:])
    (work / "train.txt").write_text("a.h5\nb.h5\n")
    assert "is 150 mm" in run_tool("calibrate_hand", "train.txt", "--out", "one.prototxt").out
    done = run_tool("calibrate_hand", "train.txt", "--out", "two.prototxt", "--template", "one.prototxt")
    one, two = (skeletons.load(work / f"{name}.prototxt") for name in ("one", "two"))
    assert np.allclose(one.bones, two.bones, atol=1e-4)
    assert "size: 1.000 of the template" in done.out


def test_people_who_differ_are_warned_of(work):
    """Frames that no single hand fits give a warning."""
    rng = np.random.default_rng(0)
    write_joints(
        "noise.h5", np.clip(kinematics_of(HAND).joints(np.zeros((20, 47))) + rng.normal(0, 0.1, (20, 31, 3)), -0.9, 0.9)
    )
    done = run_tool("calibrate_hand", "noise.h5", "--out", "noise.prototxt")
    assert "mm; check that all frames show" in done.err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["gone.h5"], "gone.h5: cannot read the HDF5 file: No such file or directory"),
        (["gone.txt"], "gone.txt: cannot read the list of HDF5 files: No such file or directory"),
        (["few.h5"], "few.h5: 19 of 19 frames have half of their joints within the cube"),
        (["depth.h5"], "depth.h5: no data set 'joint'; it has depth"),
        (["sixteen.h5"], "sixteen.h5: data set 'joint' has shape (60, 48), expected (N, 93) for 31 joints or (N, 42)"),
        (["infinite.h5"], "infinite.h5: data set 'joint' is infinite in frame 2 (1 such frames)"),
        (["me.h5", "--out", "no/me.prototxt"], "no/me.prototxt: folder no does not exist"),
        (["me.h5", "--out", "."], ".: Is a directory"),
        (["me.h5", "--template", "no.prototxt"], "no.prototxt: cannot read the prototxt: No such file or directory"),
    ],
)
def test_mistakes(work, frames, more, message):
    """An invalid input gives a one-line error, status 1 and no file."""
    write_joints("few.h5", frames[:19])
    write_joints("sixteen.h5", frames[:, :16])
    infinite = frames.copy()
    infinite[2, 4, 0] = np.inf
    write_joints("infinite.h5", infinite)
    write_hdf5("depth.h5", depth=np.zeros(3))
    err = run_tool("calibrate_hand", "--out", "x.prototxt", *more, status=1).err
    assert err.startswith(message) and err.count("\n") == 1
    assert not (work / "x.prototxt").exists()


@pytest.mark.parametrize(
    "more",
    [
        ["--frames", "19"],
        ["--joints", "13"],
        ["--half-cube", "0"],
        ["--half-cube", "nan"],
        ["--half-cube", "1e-9"],
        ["--half-cube", "1e12"],
        ["--percentile", "50"],
        ["--percentile", "nan"],
        ["--seed", "-1"],
        ["--unit", "0.125"],
        ["--hand", "left"],
        ["--from-depth", "--camera", "nyu", "--frames", "100"],
        ["--from-depth", "--camera", "nyu", "--template", "nyu.prototxt"],
    ],
)
def test_wrong_usage(work, more):
    """Wrong usage gives exit status 2."""
    run_tool("calibrate_hand", "me.h5", "--out", "me.prototxt", *more, status=2)


def test_the_frames_that_are_used_can_be_of_the_14_joints(work, frames):
    """Frames with the 14 evaluation joints, 42 numbers per row, are accepted."""
    write_joints("fourteen.h5", frames[:, EVALUATION_JOINTS])
    run_tool("calibrate_hand", "fourteen.h5", "--out", "me.prototxt")
    assert "14 of 31 joints" in (work / "me.prototxt").read_text().replace("\n# ", " ")


# ------------------------------------------------------------------------------------------- from depth alone


def test_size_from_depth(tmp_path, monkeypatch):
    """The size of a hand 0.9 times as large is found within 3% from five frames, the minimum, and is saved."""
    monkeypatch.chdir(tmp_path)
    sampler, rng = BodySampler(prior_file.load().but(scale_std=0, bone_std=0)), np.random.default_rng(2)
    hands = sampler.draw(rng, 5)
    bones = 0.9 * hands.bones
    smaller = hands._replace(bones=bones, scale=0.9 * hands.scale)
    capsules = capsules_of(sampler, rng, smaller, (20, -10, 650), dataclasses.replace(ARM_BEHIND, thickness_std=0))
    for n, depth in enumerate(render_image(capsules, KINECT2)):
        cv2.imwrite(f"{n}.png", np.where(np.isfinite(depth), depth, 0).astype(np.uint16))
    images = [f"{n}.png" for n in range(5)]
    options = ["--from-depth", "--camera", "kinect2", "--out", "me.prototxt"]
    out = run_tool("calibrate_hand", *images, *options).out
    assert re.match(r"A right hand of 0\.\d+ \+- 0\.\d+ times the size of \w+, with \d\.\d+ times its thickness", out)
    me = skeletons.load("me.prototxt")
    assert np.median(me.bones[me.bones != 0] / HAND.bones[HAND.bones != 0]) == pytest.approx(0.9, abs=0.03)
    assert "from 5 depth frames" in (tmp_path / "me.prototxt").read_text()
    done = run_tool("calibrate_hand", *images[:2], *options, "--force", status=1)
    assert "2 frames to estimate a hand's size from, expected 5 or more" in done.err
    cv2.imwrite("empty.png", np.zeros((424, 512), np.uint16))
    done = run_tool("calibrate_hand", "empty.png", *options, "--force", status=1)
    assert "empty.png: no depth anywhere in the image" in done.err


def test_a_size_at_the_end_of_what_is_tried(tmp_path, monkeypatch):
    """A size at the end of the search range is reported with a warning."""
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", np.full((424, 512), 700, np.uint16))
    last = len(GRID) - 1
    for best, warned in ((last, True), (0, True), (last - 1, False)):
        costs = np.abs(np.arange(len(GRID)) - best)
        found = HandSize(float(GRID[best]), 1.0, 0.0, GRID, costs)
        monkeypatch.setattr(calibrate_hand, "hand_of", lambda *_, size=found: ("right", size))
        command = ["a.png", "--from-depth", "--camera", "kinect2", "--out", "me.prototxt", "--force"]
        done = run_tool("calibrate_hand", *command)
        said = "warning: this is at the end of the range tried, 0.66 to 1.35"
        assert (said in done.err) == warned


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.png", "--from-depth", "--out", "x"], "--from-depth and --camera must be given together"),
        (["a.h5", "--camera", "nyu", "--out", "x"], "--from-depth and --camera must be given together"),
        (["a.h5", "b.h5", "--out", "x"], "2 ANNOTATIONS; expected one file, or a list of files"),
    ],
)
def test_usage_with_depth(arguments, message):
    """Wrong usage gives exit status 2 and a message."""
    assert message in run_tool("calibrate_hand", *arguments, status=2).err
