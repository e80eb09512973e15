"""prototxt/body: the person and the planar arm."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

import netlib
from handpose.output.hand_page.values import body
from handpose.synthetic import prior_file
from handpose.synthetic.generator import Generator, Recipe, SyntheticCamera
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.recipes import recipe_of
from handpose.synthetic.surface_prior import DEFAULT_SURFACE
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from tests.support.running import run_tool

BODY = Path(__file__).resolve().parents[2] / "prototxt" / "body"
NAMES = ("person", "arm")


def sampler_of(name: str) -> BodySampler:
    return BodySampler(prior_file.load(BODY / f"{name}_prior.prototxt"))


def held(name: str, pose: str, **degrees: float) -> dict[str, np.ndarray]:
    """Joint positions in mm in a named pose, or at rest, with some angles in degrees."""
    sampler = sampler_of(name)
    skeleton = sampler.skeleton
    inputs = (sampler.poses[pose] if pose else np.zeros(len(skeleton.dof_names)))[None].copy()
    for dof, angle in degrees.items():
        d = skeleton.dof_names.index(dof)
        inputs[0, d] = np.deg2rad(angle) - skeleton.initial[d]
    joints = kinematics_of(sampler.skeleton).joints(inputs)[0] * sampler.cube_mm / 2
    return dict(zip(skeleton.joint_names, joints, strict=True))


def test_a_person_of_adult_size() -> None:
    """The person has 21 joints and 40 DoFs, the proportions of an adult of 1.75 m, and
    symmetric sides.
    """
    skeleton = skeletons.load(BODY / "person.prototxt")
    assert (len(skeleton.joint_names), len(skeleton.dof_names)) == (21, 40)
    rest = held("person", "")
    heights = {
        joint: rest[joint][1] - rest["ankle_left"][1] + 75
        for joint in ("hip_left", "shoulder_left", "head")
    }
    assert heights["hip_left"] / 1750 == pytest.approx(0.53, abs=0.02)
    assert heights["shoulder_left"] / 1750 == pytest.approx(0.82, abs=0.02)
    assert 1600 < heights["head"] < 1680
    for joint, place in rest.items():
        if joint.endswith("_left"):
            np.testing.assert_allclose(
                place * (-1, 1, 1), rest[joint.replace("_left", "_right")], atol=1e-9
            )
            assert place[0] > 0  # the person's left, which is the camera's right
        elif not joint.endswith("_right"):
            assert place[0] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("dof", "joint", "moves"),
    [  # motion at a positive angle; forward is towards the camera, -z
        ("knee_{}_flexion", "ankle_{}", (0, 1, 1)),  # the lower leg goes up and backward
        ("elbow_{}_flexion", "wrist_{}", (0, 1, -1)),
        ("hip_{}_flexion", "knee_{}", (0, 1, -1)),
        ("hip_{}_abduction", "knee_{}", ("out", 1, 0)),
        ("shoulder_{}_flexion", "wrist_{}", (0, 1, -1)),
        ("shoulder_{}_abduction", "wrist_{}", ("out", 1, 0)),
        ("collar_{}_lift", "shoulder_{}", ("in", 1, 0)),
        ("ankle_{}_flexion", "foot_{}", (0, 1, 0)),
    ],
)
@pytest.mark.parametrize("side", ["left", "right"])
def test_limbs_bend_the_same_way_on_both_sides(
    side: str, dof: str, joint: str, moves: tuple[object, ...]
) -> None:
    """The limits of knees and elbows allow only one direction."""
    out = 1 if side == "left" else -1
    wanted = [
        {"out": out, "in": -out}.get(move, move) if isinstance(move, str) else move
        for move in moves
    ]
    before = held("person", "", **{dof.format(side): 0.0, f"shoulder_{side}_abduction": 0.0})
    after = held("person", "", **{f"shoulder_{side}_abduction": 0.0, dof.format(side): 20.0})
    change = after[joint.format(side)] - before[joint.format(side)]
    for along, expected in zip(change, wanted, strict=True):
        assert expected == 0 or along * expected > 1
    skeleton = skeletons.load(BODY / "person.prototxt")
    if dof.startswith(("knee", "elbow")):
        assert skeleton.lower[skeleton.dof_names.index(dof.format(side))] == 0


@pytest.mark.parametrize("name", NAMES)
def test_poses_with_a_name(name: str) -> None:
    """Named poses are within the limits, and no body parts intersect."""
    sampler = sampler_of(name)
    skeleton, surface = sampler.skeleton, sampler.surface
    assert len(sampler.poses) > 2
    whole = np.zeros((len(sampler.poses), len(surface.whole.initial)))
    whole[:, : len(skeleton.initial)] = list(sampler.poses.values())
    inside = (whole >= surface.whole.lower - 1e-9) & (whole <= surface.whole.upper + 1e-9)
    assert inside[:, ~surface.whole.fixed].all()
    ends = surface.ends(surface.kinematics.forward(whole))
    deep = (
        surface.penetration(ends, np.tile(surface.radii, (len(whole), 1, 1))) * sampler.cube_mm / 2
    )
    assert deep.max() < sampler.prior.penetration


def test_a_person_in_poses() -> None:
    """Raised arms have the hands above the head; seated persons have knees in front of the hips
    at their height.
    """
    up = held("person", "arms_raised")
    assert min(up["hand_left"][1], up["hand_right"][1]) > up["head"][1] + 200
    sits = held("person", "sit")
    assert sits["knee_left"][2] < sits["hip_left"][2] - 350
    assert sits["knee_left"][1] == pytest.approx(sits["hip_left"][1], abs=80)
    assert sits["ankle_left"][1] < sits["knee_left"][1] - 350
    points = held("person", "point_left")
    assert points["hand_left"][2] < points["shoulder_left"][2] - 500
    assert points["hand_right"][1] < points["hip_right"][1]


@pytest.mark.parametrize("name", NAMES)
def test_frames_show_the_whole_body(name: str) -> None:
    """All joints are in the cube and the camera sees the whole body; with a sensor's noise most
    pixels remain.
    """
    recipe = recipe_of(BODY / f"{name}_prior.prototxt")
    frames = Generator(1, "train", recipe).block(2)
    clear = Generator(
        1,
        "train",
        Recipe(recipe.prior, DEFAULT_SURFACE, (SyntheticCamera(recipe.views[0].camera, None),)),
    ).block(2)
    assert (np.abs(frames.joint) >= 1).mean() < 0.01
    shown, there = ((some.depth < 0.999).mean(axis=(1, 2, 3)) for some in (frames, clear))
    assert there.min() > 0.02 and there.max() < 0.4
    assert shown.mean() > 0.85 * there.mean()


@pytest.mark.parametrize("name", NAMES)
def test_the_tools(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands of docs/bodies.md run: frames, two iterations, a score with each
    joint, and pictures.
    """
    monkeypatch.chdir(tmp_path)
    prior, deploy = BODY / f"{name}_prior.prototxt", BODY / f"{name}_deploy.prototxt"
    weights = f"snapshots/{name}_iter_2.caffemodel.h5"
    done = run_tool(f"make_synthetic --body {prior} --train 20 --test 20 --workers 1")
    assert f"data/{name}: 20 train and 20 test frames" in done.out
    for kind in ("train_test", "solver"):
        text = (BODY / f"{name}_{kind}.prototxt").read_text()
        text = re.sub(r"batch_size: \d+", "batch_size: 20", text).replace(
            "test_iter: 10", "test_iter: 1"
        )
        text = text.replace(f"prototxt/body/{name}_train_test", f"{name}_train_test")
        text = text.replace(f'"{name}.prototxt"', f'"{BODY / name}.prototxt"')
        (tmp_path / f"{name}_{kind}.prototxt").write_text(text)
    run_tool(f"train {name}_solver.prototxt --max-iter 2")
    score = f"test --model {name}_train_test.prototxt {weights}"
    scored = json.loads(run_tool(f"{score} --picture found.png --joints --json").out)
    (row,) = scored["snapshots"]
    assert "error_14_mm" not in row and 0 <= row["out_of_limits"] <= 1
    skeleton = skeletons.load(BODY / f"{name}.prototxt")
    assert list(scored["joints_mm"]) == skeleton.joint_names
    said = run_tool(f"{score} --joints").out
    assert "out of limits" in said
    assert "14 joints" not in said
    assert all(joint in said for joint in skeleton.joint_names)
    deployed = netlib.Net(deploy, weights, netlib.TEST)
    found = deployed.forward(depth=np.ones((1, 1, 128, 128), np.float32))
    assert found["pred"].shape == (1, 3 * len(skeleton.joint_names))
    body = BODY / f"{name}.prototxt"
    run_tool(f"show_data data/{name}/test.txt --out frames.png --skeleton {body}")
    assert cv2.imread("found.png") is not None
    picture = cv2.imread("frames.png")
    # limbs in colours
    assert picture is not None and np.ptp(picture.astype(int), axis=2).max() > 100
    done = run_tool(f"{score} --fit fast", status=1)
    assert (
        f"its body is 'nyu', that of {name}_train_test.prototxt is '{name}'; expected" in done.err
    )
    cv2.imwrite("crop.png", np.full((128, 128), 128, np.uint8))
    see = f"predict crop.png --model {deploy} --weights {weights} --fit no"
    for command in (see, f"export_onnx {deploy} {weights} net.onnx"):
        done = run_tool(command, status=1)
        assert (
            f"skeleton '{name}' is not a hand: it has no joint 'palm'; expected the edge"
            in done.err
        )
        run_tool(f"{command} --cube 1000")
    assert cv2.imread("crop_body.png") is not None


def test_a_page_of_a_person() -> None:
    """On the page of a person, the distance of the camera grows with the size of the cube."""
    skeleton = skeletons.load(BODY / "person.prototxt")
    place = body("person", skeleton, unit_mm=1200.0)["place"]
    assert place["center_uvd"][2] == 5600 and place["unit_mm"] == 1200
    assert body("hand", skeletons.load())["place"]["center_uvd"][2] == 700


def test_unsuitable_bodies_and_recipes_are_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A body without a name has no folder, a skeleton is no prior, and recipes are
    for hands only.
    """
    monkeypatch.chdir(tmp_path)
    for name in ("arm", "arm_prior"):
        text = (BODY / f"{name}.prototxt").read_text().replace('name: "arm"', 'name: "../arm"', 1)
        (tmp_path / f"{name}.prototxt").write_text(text)
    done = run_tool("make_synthetic --body arm_prior.prototxt", status=1)
    assert done.err.startswith("arm_prior.prototxt: its skeleton is named")
    assert "arm.prototxt:" in run_tool("make_synthetic --body arm.prototxt", status=1).err
    done = run_tool("make_synthetic --body arm_prior.prototxt --recipe nyu --out x", status=2)
    assert "--recipe applies only to hands" in done.err and not (tmp_path / "x").exists()
