"""The JavaScript of the hand page computes the same values as this project."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.body.capsules import CLEAR_MM, Capsules, in_front
from handpose.body.model import Surface
from handpose.body.render import render_crop
from handpose.frames.cameras import ICVL, KINECT2, NYU, Camera
from handpose.frames.crops import crop
from handpose.output.hand_page.values import skeleton_values
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import Skeleton
from tests.handpose.output.hand_page.conftest import ARM, any_body, ask
from tests.support.made_tracks import skeleton_of

MM = 150.0
HANDS = {
    name: skeletons.load(skeletons.NYU_HAND.with_name(f"{name}.prototxt"))
    for name in ("nyu", "people", "icvl")
}
BODIES = {
    **HANDS,
    "arm": skeleton_of(ARM),
    **{f"any body {seed}": any_body(seed) for seed in range(4)},
}

COMPUTED = """([skeleton, poses, forces, side]) => {
  const body = new hand.Body({ skeleton, place: hand.data.bodies[0].place });
  body.side = side;
  return poses.map((inputs, n) => {
    Object.assign(body, { inputs, forces: forces[n] });
    body.notify("pose");
    return { outputs: body.outputs, joints: n % 20 ? [] : body.joints, torques: body.torques, loss: body.limitLoss };
  });
}"""


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("name", BODIES)
def test_joints_torques_and_limits(tab: Any, name: str, side: str) -> None:
    skeleton = BODIES[name]
    rng = np.random.default_rng(1)
    whole = skeleton.with_surface() if skeleton.param.flesh else skeleton
    K, D = len(skeleton.joint_names), len(skeleton.dof_names)
    poses, forces = rng.normal(0, 1.2, (200, len(whole.initial))), rng.normal(0, 3, (200, K, 3))
    mirror = np.array([-1 if side == "left" else 1, 1, 1])
    found = ask(tab, COMPUTED, [skeleton_values(skeleton), poses.tolist(), forces.tolist(), side])

    kinematics = Kinematics(skeleton)
    pose = kinematics.forward(poses[:, :D])
    outputs, torques = (np.array([one[key] for one in found]) for key in ("outputs", "torques"))
    joints = np.array([one["joints"] for one in found[::20]])
    assert_allclose(outputs, pose.joints * mirror, atol=1e-6)
    expected = pose.joints[::20] * mirror * MM + (0, 0, 700)
    assert_allclose(joints[:, :K], expected, atol=1e-4)
    expected = kinematics.backward(pose, forces * mirror)
    turns = np.isin(np.arange(D), whole.driven[whole.turns])
    assert_allclose(torques[:, :D], expected * np.where(turns, MM, 1), rtol=1e-6, atol=1e-6)
    assert np.abs(expected).max() > 1 and (torques[:, D:] == 0).all()
    beyond = np.maximum(poses[:, :D] - skeleton.upper, 0) + np.maximum(
        skeleton.lower - poses[:, :D], 0
    )
    beyond[:, skeleton.fixed] = 0
    assert_allclose([one["loss"]["L1"] for one in found], beyond.sum(axis=1), rtol=1e-9)
    assert_allclose([one["loss"]["L2"] for one in found], (beyond**2).sum(axis=1), rtol=1e-9)


RENDERED = """([skeleton, bodies]) => bodies.map(([values, camera, uvd, cube]) => {
  const body = new hand.Body({ skeleton, place: hand.data.bodies[0].place });
  Object.assign(body, values, { unit: cube / 2 });
  body.change({ camera, uvd, cube });
  const ends = body.capsules.map(({ a, b, ra, rb }) => [...a, ...b, ra, rb]);
  const depth = [...hand.renderCrop(body.capsules, uvd, cube, camera)];
  return { ends, depth: depth.map((mm) => Math.round(mm * 1e3) / 1e3) };
})"""


def rendered(
    tab: Any, skeleton: Skeleton, bodies: list[Any]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The capsules (M, 8) and the depth (128, 128) that the page computes for some bodies."""
    found = ask(tab, RENDERED, [skeleton_values(skeleton), bodies])
    return [(np.array(one["ends"]), np.array(one["depth"]).reshape(128, 128)) for one in found]


def check_depth(found: np.ndarray, expected: np.ndarray) -> None:
    """To 0.2 mm, except for a few pixels on outlines, where rounding to 32 bits decides which
    surface is in front.
    """
    off = np.abs(found - expected)
    assert (off > 0.2).mean() < 0.0006
    assert (off > 0.05).mean() < 0.01
    assert (expected < expected.max()).mean() > 0.02  # the body is visible


def rows_of(capsules: Capsules, n: int) -> np.ndarray:
    radii = [capsules.radius_a[n][:, None], capsules.radius_b[n][:, None]]
    return np.concatenate([capsules.a[n], capsules.b[n], *radii], axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_the_depth_of_any_body(tab: Any, seed: int) -> None:
    """For nested spheres, cones seen from their tip, and parts behind the camera."""
    skeleton, rng = any_body(seed), np.random.default_rng(seed)
    surface, uvd = Surface(skeleton), np.array([300.0, 250, 280 + 200 * seed])
    inputs = rng.normal(0, 0.8, (4, len(surface.whole.initial)))
    ends = surface.ends(kinematics_of(surface.whole).forward(inputs)) * MM + NYU.unproject(uvd)
    radii = np.broadcast_to(surface.radii * MM, (4, *surface.radii.shape))
    capsules = Capsules(ends[:, surface.start], ends[:, surface.end], radii[..., 0], radii[..., 1])
    expected = render_crop(in_front(capsules, CLEAR_MM), np.tile(uvd, (4, 1)), 2 * MM, NYU)
    bodies = [[{"inputs": one}, vars(NYU), uvd.tolist(), 2 * MM] for one in inputs.tolist()]
    for n, (found, depth) in enumerate(rendered(tab, skeleton, bodies)):
        assert_allclose(found, rows_of(capsules, n), atol=1e-6)
        check_depth(depth, expected[n])


@pytest.mark.parametrize(
    ("camera", "place"),
    [(NYU, (15, -20)), (KINECT2, (15, -20)), (ICVL, (15, -20)), (NYU, (-315, -240))],
    ids=["nyu", "kinect2", "icvl", "at the corner"],
)
def test_points_are_where_the_camera_saw_them(
    tab: Any, camera: Camera, place: tuple[float, float], rng: np.random.Generator
) -> None:
    """Every pixel of the frame within the cube yields one point, as unprojected by the
    camera; no others do.
    """
    uvd = np.array([camera.u0 + place[0], camera.v0 + place[1], 800.0])
    frame = rng.uniform(500, 1100, (camera.height, camera.width)).astype(np.float32)
    frame[rng.random(frame.shape) < 0.3] = 0
    given = [crop(frame, uvd, 300.0, camera).ravel().tolist(), uvd.tolist(), 300.0, vars(camera)]
    found = np.reshape(ask(tab, "(given) => hand.cropPoints(...given)", given), (-1, 3))
    pixels = camera.project(found + camera.unproject(uvd))
    columns, rows = (np.rint(pixels[:, i]).astype(int) for i in (0, 1))
    assert_allclose(pixels[:, :2], np.stack([columns, rows], axis=1), atol=1e-6)
    assert_allclose(pixels[:, 2], frame[rows, columns], atol=1e-3)
    assert len(np.unique(pixels[:, :2].round(), axis=0)) == len(found) > 1000
    assert (np.abs(found[:, 2]) < 150).all()
    assert pixels[:, :2].min() > -1e-6
