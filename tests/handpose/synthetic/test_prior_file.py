"""handpose/synthetic/prior_file.py, and bodies from other files than the hand's"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.frames.cameras import CAMERAS
from handpose.synthetic import prior_file
from handpose.synthetic.generator import BLOCK, Generator
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.prior_parameters import PosePrior
from handpose.synthetic.recipes import check_in_view, recipe, recipe_of
from layers.hand.bodies import kinematics_of
from netlib.errors import NetlibError, PrototxtError
from tests.support.bad_input import bad_inputs, in_table

SKELETON = """\
name: "tail"
dof { name: "x" } dof { name: "y" } dof { name: "z" }
dof { name: "turn" initial: 0.5 }
dof { name: "a" lower: -1 upper: 0.5 } dof { name: "b" lower: 0 upper: 2 } dof { name: "c" lower: -0.5 upper: 0.5 }
dof { name: "still" fixed: true }
joint {
  name: "root"
  translate { axis: X dof: "x" } translate { axis: Y dof: "y" } translate { axis: Z dof: "z" }
  rotate { axis: Z dof: "turn" }
}
joint { name: "first" parent: "root" rotate { axis: X dof: "a" } bone { axis: Y length: 0.3 } }
joint { name: "second" parent: "first" rotate { axis: X dof: "b" } bone { axis: Y length: 0.3 } }
joint { name: "third" parent: "second" rotate { axis: Z dof: "c" } bone { axis: Y length: 0.2 } }
flesh {
  capsule { from: "root" to: "first" radius: 0.1 }
  capsule { from: "first" to: "second" radius: 0.1 radius: 0.05 }
  capsule { from: "second" to: "third" radius: 0.05 }
}
"""
PRIOR = """\
skeleton: "tail.prototxt"
camera: "kinect2"
cube_mm: 1000
center { joint: "root" y: 100 }
depth { low: 2000 high: 2500 }
turn { dof: "turn" mean: 30 std: 5 }
bend { shared { a: 2 b: 2 } chain { name: "tail" dof: "a" dof: "b" } }
between { dof: "c" }
pose { name: "curled" bend { of: "tail" part: 1 } at { of: "c" part: 0.5 } }
"""


@pytest.fixture()
def tail(tmp_path: Path) -> Path:
    """A prior file with its skeleton in the same folder."""
    (tmp_path / "tail.prototxt").write_text(SKELETON)
    path = tmp_path / "tail_prior.prototxt"
    path.write_text(PRIOR)
    return path


def test_the_hands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The packaged prior is found from any folder, has NYU's hand, and its gestures
    use every finger.
    """
    monkeypatch.chdir(tmp_path)
    prior = prior_file.load()
    assert prior.body().name == "nyu" and prior.cube_mm == 300 and prior.camera in CAMERAS
    assert len(prior.pose) == 11
    assert all(len(pose.bend) == 4 and len(pose.at) == 4 for pose in prior.pose)
    again: PosePrior = pickle.loads(pickle.dumps(prior.but(redraws=3)))
    assert again.redraws == 3 and again.body() is prior.body()


def test_another_body(tail: Path) -> None:
    """Its frames are drawn, posed and rendered as described in its files, also after pickling."""
    made = recipe_of(tail)
    assert made.views[0].camera.name == "kinect2"
    generator: Generator = pickle.loads(pickle.dumps(Generator(3, "train", made)))
    frames = generator.block(0)
    assert frames.dof is not None and frames.bones is not None
    posed = kinematics_of(generator.sampler.skeleton).joints(
        frames.dof.astype(float), frames.bones.astype(float)
    )
    assert_allclose(posed.reshape(BLOCK, -1), frames.joint, atol=1e-6)
    assert (frames.half_cube == 500).all() and (frames.depth < 1).any(axis=(1, 2, 3)).all()
    turn = np.degrees(frames.dof[:, 3] + 0.5)
    assert turn.mean() == pytest.approx(30, abs=3) and 2 < turn.std() < 8
    # ``a`` goes from its lower to its upper limit while ``b`` goes from its lower to its upper one
    assert_allclose((frames.dof[:, 4] + 1) / 1.5, frames.dof[:, 5] / 2, atol=1e-6)


def test_the_crop_centre(tail: Path, rng: np.random.Generator) -> None:
    """The crop centre is at the given position in the frame of its joint, for any rotation."""
    sampler = BodySampler(prior_file.load(tail))
    bodies = sampler.draw(rng, 50)
    kinematics = kinematics_of(sampler.skeleton)
    pose = kinematics.forward(bodies.inputs, bodies.bones)
    frame = kinematics.rotation_of(pose, 0)
    assert_allclose(bodies.joints[:, 0] + frame @ [0, 0.2, 0], 0, atol=1e-12)


def test_poses_with_a_name(tail: Path, rng: np.random.Generator) -> None:
    """Named poses are parts of the ranges, and blends of them stay within the limits."""
    prior = prior_file.load(tail)
    sampler = BodySampler(prior)
    assert_allclose(sampler.poses["curled"], [0, 0, 0, 0, 0.5, 2, 0, 0])
    only = BodySampler(prior.but(blend=1.0))
    assert_allclose(only.draw(rng, 20).inputs[:, 4:7] - [0.5, 2, 0], 0, atol=1e-12)


def test_one_hand_and_a_second() -> None:
    """Training frames have the packaged hand; test blocks alternate with a second, constant one in
    smaller crops.
    """
    made = recipe("one_hand")
    hand = made.prior.body()
    for split, number, same in (
        ("train", 0, True),
        ("train", 1, True),
        ("test", 0, True),
        ("test", 1, False),
    ):
        scene = Generator(4, split, made).scene(number)  # type: ignore[arg-type]
        own = scene.bodies.bones[:, : len(hand.bones)]
        assert (own == own[0]).all() and (own[0] == hand.bones).all() == same
        assert scene.cube_mm == (300 if same else 261)
    again = Generator(5, "test", made).scene(3).bodies.bones
    assert_array_equal(again[0, : len(hand.bones)], own[0])


@bad_inputs(
    PrototxtError,
    {
        **in_table(Path(__file__).with_name("prior_mistakes.txt"), "...tail_prior.prototxt:"),
        "no skeleton": (
            ('"tail.prototxt"', '"tial.prototxt"'),
            NetlibError,
            "tial.prototxt: cannot read the prototxt: No such file or directory",
        ),
    },
)
def test_refusals(tail: Path, given: Sequence[str], rejected: Any) -> None:
    assert given[0] in PRIOR + SKELETON
    tail.write_text(PRIOR.replace(*given, 1))
    tail.with_name("tail.prototxt").write_text(
        SKELETON if given[0] in PRIOR else SKELETON.replace(*given)
    )
    with rejected:
        prior_file.load(tail)


def test_a_skeleton_is_no_prior(tail: Path) -> None:
    line = r'tail.prototxt:\d+:\d+: error: found a skeleton; .*: skeleton: "tail.prototxt"'
    with pytest.raises(PrototxtError, match=line):
        prior_file.load(tail.with_name("tail.prototxt"))


def test_the_skeleton_beside_the_prior_comes_first(
    tail: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tail.parent / "other"
    other.mkdir()
    (other / "tail.prototxt").write_text('name: "other" joint { name: "root" }')
    monkeypatch.chdir(other)
    assert prior_file.load(tail).body().name == "tail"


@pytest.mark.parametrize(
    ("old", "new"), [("0.3", "5"), ("cube_mm: 1000", "cube_mm: 1"), ("y: 100", "y: 3000")]
)
def test_a_body_beside_the_crops(tail: Path, old: str, new: str) -> None:
    """Lengths beyond the cube, a cube of 1 mm and a distant centre raise an error before
    frames are made.
    """
    tail.with_name("tail.prototxt").write_text(SKELETON.replace(old, new))
    tail.write_text(PRIOR.replace(old, new))
    with pytest.raises(
        NetlibError, match=r"of the joints lie outside the crops.*expected lengths in half-cubes"
    ):
        check_in_view(recipe_of(tail), 0)
