"""The page's JavaScript modules compute the same values as this project, and read files alike."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.body.model import Surface
from handpose.body.render import CLEAR_MM, Capsules, in_front, render_crop
from handpose.fit.body import CapsuleModel
from handpose.frames.cameras import CAMERAS, KINECT2, NYU, Camera
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import Skeleton
from netlib.errors import PrototxtError
from tests.handpose.output.drawing.page.conftest import ARM, any_body, ask, body_of

HAND = str(skeletons.NYU_HAND.read_text(encoding="utf-8"))
NETLIB = Path(__file__).parents[4] / "netlib" / "proto"
MM = 150.0

# Bodies that are not drawn: their poses, and the gradients of forces on them.
COMPUTED = """([text, poses, forces, side]) => {
  const body = new hand.Body(text, "body.prototxt", hand.data.place);
  body.side = side;
  return poses.map((inputs, n) => {
    Object.assign(body, { inputs, forces: forces[n] });
    body.changed("pose");
    return { answer: body.answer, joints: n % 20 ? [] : body.joints, torques: body.torques, loss: body.limitLoss };
  });
}"""
ICVL = str(skeletons.NYU_HAND.with_name("icvl.prototxt").read_text(encoding="utf-8"))
FILES = {"hand": HAND, "icvl": ICVL, "arm": ARM, **{f"any body {seed}": any_body(seed) for seed in range(4)}}


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("name", FILES)
def test_joints_and_torques(tab: Any, name: str, side: str) -> None:
    """For 200 random poses, joints, torques and the loss of limits agree to 1e-6; a left hand is mirrored."""
    skeleton, rng = body_of(FILES[name]), np.random.default_rng(1)
    whole = skeleton.with_surface() if skeleton.param.flesh else skeleton
    K, D = len(skeleton.joint_names), len(skeleton.dof_names)
    poses, forces = rng.normal(0, 1.2, (200, len(whole.initial))), rng.normal(0, 3, (200, K, 3))
    mirror = np.array([-1 if side == "left" else 1, 1, 1])
    found = ask(tab, COMPUTED, [FILES[name], poses.tolist(), forces.tolist(), side])

    kinematics = Kinematics(skeleton)
    pose = kinematics.forward(poses[:, :D])
    answer, torques = (np.array([one[key] for one in found]) for key in ("answer", "torques"))
    joints = np.array([one["joints"] for one in found[::20]])
    np.testing.assert_allclose(answer, pose.joints * mirror, atol=1e-6)
    np.testing.assert_allclose(joints[:, :K], pose.joints[::20] * mirror * MM + (0, 0, 700), atol=1e-4)
    expected = kinematics.backward(pose, forces * mirror)
    turns = np.zeros(D, dtype=bool)
    turns[skeleton.driven[skeleton.turns]] = True
    np.testing.assert_allclose(torques[:, :D], expected * np.where(turns, MM, 1), rtol=1e-6, atol=1e-6)
    assert np.abs(expected).max() > 1 and (torques[:, D:] == 0).all()
    beyond = np.maximum(poses[:, :D] - skeleton.upper, 0) + np.maximum(skeleton.lower - poses[:, :D], 0)
    beyond[:, skeleton.fixed] = 0
    np.testing.assert_allclose([one["loss"]["L1"] for one in found], beyond.sum(axis=1), rtol=1e-9)
    np.testing.assert_allclose([one["loss"]["L2"] for one in found], (beyond**2).sum(axis=1), rtol=1e-9)


DRAWN = """([text, bodies]) => bodies.map(([values, camera, uvd, cube]) => {
  const body = new hand.Body(text, "body.prototxt", hand.data.place);
  Object.assign(body, values, { unit: cube / 2 });
  body.look({ camera, uvd, cube });
  const ends = body.capsules.map(({ a, b, ra, rb }) => [...a, ...b, ra, rb]);
  const depth = [...hand.renderCrop(body.capsules, uvd, cube, camera)];
  return { ends, depth: depth.map((mm) => Math.round(mm * 1e3) / 1e3) };
})"""


def drawn(tab: Any, text: str, bodies: list[Any]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The capsules (M, 8) and the depth (128, 128) that the page computes for some bodies."""
    found = ask(tab, DRAWN, [text, bodies])
    return [(np.array(one["ends"]), np.array(one["depth"]).reshape(128, 128)) for one in found]


def check_depth(found: np.ndarray, expected: np.ndarray) -> None:
    """To 0.2 mm, except for a few pixels on outlines, where rounding to 32 bits decides which surface is in front."""
    off = np.abs(found - expected)
    assert (off > 0.2).mean() < 0.0006
    assert (off > 0.05).mean() < 0.01
    assert (expected < expected.max()).mean() > 0.02  # the body is visible


@pytest.mark.parametrize("camera", [NYU, KINECT2, Camera("own", 400.5, 380.25, 100.0, 90.0, 320, 240)])
def test_the_depth_of_hands(tab: Any, camera: Camera) -> None:
    """The depth of hands of any pose, size, thickness and place equals that of the renderer."""
    rng, sampler = np.random.default_rng(2), BodySampler()
    hands, cube = sampler.draw(rng, 6), 300.0
    model = CapsuleModel(sampler.skeleton, cube / 2)
    x = model.variables_of(hands.inputs)
    x[:, model.own] = rng.uniform(-0.5, 0.5, (len(x), len(model.own)))
    x[:, -2:] = rng.uniform(-0.2, 0.2, (len(x), 2))
    uvd = np.stack([rng.uniform(60, 200, 6), rng.uniform(60, 180, 6), rng.uniform(420, 1500, 6)], axis=1)
    capsules = model.capsules(x, camera.unproject(uvd))
    near = in_front(capsules)
    expected = render_crop(near, uvd, cube, camera)
    sizes = np.exp(x[:, -2:])
    bodies = [
        [{"inputs": inputs, "size": size, "thickness": thickness}, vars(camera), middle, cube]
        for inputs, (size, thickness), middle in zip(model.whole_inputs_of(x).tolist(), sizes.tolist(), uvd.tolist())
    ]
    for n, (ends, depth) in enumerate(drawn(tab, HAND, bodies)):
        np.testing.assert_allclose(ends, _rows(capsules, n), atol=0.01)  # the model is in float32
        check_depth(depth, expected[n])


def test_the_edges_of_wedges(tab: Any) -> None:
    """The edges of wedges are capsules, in the same order as in the fit."""
    people = skeletons.NYU_HAND.with_name("people.prototxt")
    model, uvd = CapsuleModel(skeletons.load(people), 150.0), np.array([[300.0, 250, 700]])
    x = model.variables_of(np.random.default_rng(0).normal(0, 0.2, (1, 47)))
    inputs = model.whole_inputs_of(x)[0].tolist()
    bodies = [[{"inputs": inputs, "size": 1, "thickness": 1}, vars(NYU), uvd[0].tolist(), 300.0]]
    ((ends, _),) = drawn(tab, people.read_text(encoding="utf-8"), bodies)
    np.testing.assert_allclose(ends, _rows(model.capsules(x, NYU.unproject(uvd)), 0), atol=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_the_depth_of_any_body(tab: Any, seed: int) -> None:
    """The depth of nested spheres, cones seen from their tip, and parts behind the camera equals the renderer's."""
    skeleton, rng = body_of(any_body(seed)), np.random.default_rng(seed)
    surface, uvd = Surface(skeleton), np.array([300.0, 250, 280 + 200 * seed])
    inputs = rng.normal(0, 0.8, (4, len(surface.whole.initial)))
    ends = surface.ends(kinematics_of(surface.whole).forward(inputs)) * MM + NYU.unproject(uvd)
    radii = np.broadcast_to(surface.radii * MM, (4, *surface.radii.shape))
    capsules = Capsules(ends[:, surface.start], ends[:, surface.end], radii[..., 0], radii[..., 1])
    expected = render_crop(in_front(capsules, CLEAR_MM), np.tile(uvd, (4, 1)), 2 * MM, NYU)
    bodies = [[{"inputs": one}, vars(NYU), uvd.tolist(), 2 * MM] for one in inputs.tolist()]
    for n, (found, depth) in enumerate(drawn(tab, any_body(seed), bodies)):
        np.testing.assert_allclose(found, _rows(capsules, n), atol=1e-6)
        check_depth(depth, expected[n])


def _rows(capsules: Capsules, n: int) -> np.ndarray:
    radii = [capsules.radius_a[n][:, None], capsules.radius_b[n][:, None]]
    return np.concatenate([capsules.a[n], capsules.b[n], *radii], axis=1)


def test_the_cameras_are_those_of_the_project(tab: Any) -> None:
    """The list of cameras has the names of the project's cameras."""
    names = tab.locator("#camera option").all_text_contents()
    assert names == list(CAMERAS)


# ---------------------------------------------------------------------------------------------- file contents

PARSED = """(texts) => texts.map(([name, text]) => {
  const lists = (message) => message.fields.map(({ name, value }) => (
    [name, value.kind === "message" ? lists(value) : [value.kind, value.text]]
  ));
  try { return lists(hand.parse(text, name)); } catch (error) { return error.message; }
})"""


def test_the_same_texts_are_prototxt(tab: Any) -> None:
    """Valid files give the trees of netlib/proto/prototxt.py, and invalid ones its messages."""
    paths = sorted([*NETLIB.glob("valid/*.prototxt"), *NETLIB.glob("invalid/*.prototxt")])
    texts = [[path.name, path.read_text(encoding="utf-8")] for path in paths]
    found = ask(tab, PARSED, texts)
    assert len(paths) > 30
    for path, tree in zip(paths, found):
        if path.parent.name == "valid":
            assert tree == json.loads(path.with_suffix(".json").read_text(encoding="utf-8")), path
        else:
            assert tree == path.with_suffix(".txt").read_text(encoding="utf-8").rstrip("\n"), path


MISTAKES = [
    ('parent: "base"', 'parent: "bse"'),
    ('axis: Z dof: "elbow"', 'axis: Z dof: "elbov"'),
    ('name: "elbow" parent: "base"', 'name: "elbow" parent: "hand"'),
    ('dof { name: "x" }', 'dof { name: "elbow" }'),
    ('joint { name: "base"', 'joint { name: "hand"'),
    ("lower: -1 upper: 1", "lower: 1 upper: -1.5"),
    ("axis: Z", "axis: W"),
    ("axis: Z", 'axis: "Z"'),
    ("axis: Z", "axis: 7"),
    ("length: 0.75", "lenght: 0.75"),
    ("bone { axis: X length: 0.75 }", "bone { axis: X }"),
    ("length: 0.75", "length: nan"),
    ("length: 0.75", "length: 123.456789"),
    ("length: 0.75", "length: 0.75 length: 1"),
    ("length: 0.75", "length { }"),
    ("initial: 0.25", "initial: inf"),
    ("initial: 0.25", "fixed: 2"),
    ("bone { axis: X length: 0.75 }", "bone: 1"),
    ('name: "arm"', "name: arm"),
    ('name: "arm"', 'name: "arm" flesh { }'),
    ('name: "arm"', 'name: "arm" flesh { capsule { from: "base" to: "hend" radius: 1 } }'),
    ('name: "arm"', 'name: "arm" flesh { capsule { from: "base" to: "hand" } }'),
    ('name: "arm"', 'name: "arm" flesh { capsule { from: "base" to: "hand" radius: [0.5, -1.5] } }'),
    ('name: "arm"', 'name: "arm" flesh { capsule { from: "base" to: "hand" radius: 12.5 } }'),
    (
        'name: "arm"',
        'name: "arm" flesh { capsule { from: "base" to: "hand" radius: 1 } '
        'offset { joint: "hand" axes: "base" y: 40 } }',
    ),
    ('name: "arm"', 'name: "arm" flesh { dof { name: "x" } capsule { from: "base" to: "hand" radius: 1 } }'),
]


def test_mistakes_in_skeleton_files(tab: Any) -> None:
    """The message equals Python's, without the suggestion of a known name."""
    texts = [ARM.replace(old, new, 1) for old, new in MISTAKES] + ["", 'dof { name: "x" }']
    assert ARM not in texts
    opened = """(texts) => texts.map((text) => {
      try { new hand.Body(text, "arm.prototxt", hand.data.place); } catch (error) { return error.message; }
      return "nothing is wrong";
    })"""
    for text, line in zip(texts, ask(tab, opened, texts)):
        with pytest.raises(PrototxtError) as refused:
            skeleton = body_of(text, "arm.prototxt")
            Surface(skeleton)
        assert _without_advice(line) == _without_advice(str(refused.value)), text


def _without_advice(line: str) -> str:
    return line.split(" (did you mean")[0].split("; known")[0]


POSED = """([form, inputs]) => {
  const { body } = hand;
  inputs.forEach((value, d) => (body.inputs[d] = value));
  body.changed("pose");
  const text = form === "inputs" ? hand.asInputs(body) : hand.asDofs(body), before = body.answer;
  body.move(Object.fromEntries(body.inputs.map((_, d) => [d, 0])));
  body.move(hand.inputsOf(text, body));
  return { text, before, after: body.answer };
}"""


@pytest.mark.parametrize("form", ["inputs", "prototxt"])
def test_a_pose_as_text(tab: Any, form: str) -> None:
    """Pasted back, the text gives the same pose; it is also valid at the start of a skeleton file."""
    skeleton = skeletons.load()
    inputs = np.random.default_rng(3).normal(0, 1, len(skeleton.initial))
    found = ask(tab, POSED, [form, inputs.tolist()])
    expected = Kinematics(skeleton).joints(inputs[None])[0]
    np.testing.assert_allclose(found["before"], expected, atol=1e-9)
    np.testing.assert_allclose(found["after"], expected, atol=1e-7)
    if form == "inputs":
        again = Kinematics(skeleton).joints(np.array([json.loads(found["text"])]))[0]
    else:
        begins: Skeleton = body_of(found["text"] + HAND[HAND.index("joint {") :])
        again = Kinematics(begins).joints(np.zeros((1, len(inputs))))[0]
        free = ~skeleton.fixed
        moved = np.stack([begins.lower + inputs, begins.upper + inputs])[:, free]
        np.testing.assert_allclose(moved, np.stack([skeleton.lower, skeleton.upper])[:, free], rtol=1e-6)
    np.testing.assert_allclose(again, expected, atol=1e-7)
