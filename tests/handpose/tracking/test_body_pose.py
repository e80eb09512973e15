"""handpose/tracking/body_pose.py: beside the kinematics, for roots of every kind"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.depth_fit.body import SIZE, CapsuleModel
from handpose.tracking.body_pose import PoseConverter, WorldPose, motion_between, moved
from layers.hand.bodies import kinematics_of
from netlib.errors import NetlibError
from tests.support.made_tracks import skeleton_of

CENTERS = st.tuples(*(st.floats(-500, 500),) * 3)
SEEDS = st.integers(0, 10**6)

# A body of three joints; its root moves along the axes %s and turns about the axes %s, each from somewhere.
BODY = """name: "made up"
dof {{ name: "x" initial: 0.1 }} dof {{ name: "y" initial: -0.2 }} dof {{ name: "z" {z} }}
dof {{ name: "a" initial: 0.3 }} dof {{ name: "b" initial: -0.4 }} dof {{ name: "c" initial: 0.2 }}
dof {{ name: "bend" lower: -1.5 upper: 1.5 }}
joint {{ name: "root" {slides} {turns} }}
joint {{ name: "one" parent: "root" bone {{ axis: X length: 0.5 }} }}
joint {{ name: "two" parent: "one" rotate {{ axis: Z dof: "bend" }} bone {{ axis: Y length: 0.4 }} }}
flesh {{ capsule {{ from: "root" to: "one" radius: 0.1 radius: 0.1 }}
        capsule {{ from: "one" to: "two" radius: 0.1 radius: 0.05 }} }}
"""


def body(slides: str = "X Y Z", turns: str = "Z X Y", z: str = "", angles: str = "abc") -> CapsuleModel:
    """With a root that moves so; axes may be NEG_X and so on."""
    made = {
        kind: " ".join(f'{kind} {{ axis: {axis} dof: "{name}" }}' for axis, name in zip(axes.split(), names))
        for kind, axes, names in (("translate", slides, "xyz"), ("rotate", turns, angles))
    }
    return CapsuleModel(skeleton_of(BODY.format(slides=made["translate"], turns=made["rotate"], z=z)), 150.0)


ROOTS = [
    *(body(turns=" ".join(order)) for order in itertools.permutations("XYZ")),
    body("NEG_X Y NEG_Z", "NEG_Z X NEG_Y"),
    body("Z NEG_X Y", "Y NEG_Z NEG_X"),
]


def any_x(model: CapsuleModel, seed: int) -> np.ndarray:
    """Variables (V,), the root's angles in all directions."""
    x = np.random.default_rng(seed).uniform(-1, 1, model.variables)
    x[model.root] *= 4
    return x


def check_round_trip(model: CapsuleModel, x: np.ndarray, first: np.ndarray, second: np.ndarray) -> None:
    """The joints, in space, are the same about another centre; the root's angles are within half a turn."""
    converter = PoseConverter(model)
    body = converter.world_pose(x, first)
    again = converter.variables(body, second)
    np.testing.assert_allclose(model.joints(again[None])[0] + second, model.joints(x[None])[0] + first, atol=1e-3)
    np.testing.assert_array_equal(again[converter.others], x[converter.others])
    turns = np.setdiff1d(model.root, converter._slides)
    assert (np.abs(again[turns]) <= np.pi).all()


@given(seed=SEEDS, first=CENTERS, second=CENTERS)
def test_there_and_back(model: CapsuleModel, seed: int, first: tuple[float, ...], second: tuple[float, ...]) -> None:
    """Any pose of the hand, about any centre."""
    check_round_trip(model, any_x(model, seed), np.array(first), np.array(second))


@pytest.mark.parametrize("made", ROOTS, ids=lambda made: " ".join(str(m) for m in PoseConverter(made)._axes))
def test_roots_of_all_kinds(made: CapsuleModel) -> None:
    """Whatever the order of its axes, and their signs; also where two of them coincide."""
    for seed in range(30):
        check_round_trip(made, any_x(made, seed), np.zeros(3), np.array([10.0, 20, 700]))
    x = any_x(made, 0)
    middle = made.root[4]  # x, y, z, a, b, c
    for pole in (0.5, 1.5, -0.5):
        x[middle] = pole * np.pi + 0.4  # its initial value is -0.4, or its negative
        check_round_trip(made, x, np.zeros(3), np.zeros(3))
        x[middle] = pole * np.pi - 0.4
        check_round_trip(made, x, np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("made", [None, *ROOTS[:2], ROOTS[-1]], ids=["hand", "a", "b", "c"])
def test_place_and_rotation(model: CapsuleModel, made: CapsuleModel | None) -> None:
    """Are the root's, as the kinematics have them."""
    own = made or model
    kinematics, converter, center = kinematics_of(own.skeleton), PoseConverter(own), np.array([5.0, -30, 650])
    for seed in range(20):
        x = any_x(own, seed)
        x[SIZE] = 0
        pose = kinematics.forward(own.inputs_of(x[None]))
        root = int(np.flatnonzero(own.skeleton.parents < 0)[0])
        placed = converter.world_pose(x, center)
        np.testing.assert_allclose(placed.place, pose.joints[0, root] * 150 + center)
        np.testing.assert_allclose(placed.rotation, kinematics.rotation_of(pose, root)[0], atol=1e-12)
        np.testing.assert_array_equal(placed.rotation, converter.rotation(x))


@pytest.mark.parametrize(
    "kind",
    [("X Y", "Z X Y"), ("X Y Y", "Z X Y"), ("X Y Z", "Z X"), ("X Y Z", "Z X Z"), ("X Y Z", "Z X Y", "fixed: true"),
     ("X Y Z", "Z X Y", "", "abb")],
    ids=["two slides", "one slide twice", "two turns", "one turn twice", "a fixed DoF", "one DoF for two"],
)  # fmt: skip
def test_other_roots(kind: tuple[str, ...]) -> None:
    """Cannot be followed."""
    with pytest.raises(NetlibError, match="skeleton 'made up': its root does not translate along x, y, z and turn"):
        PoseConverter(body(*kind))


@given(seed=SEEDS, seconds=st.floats(0.01, 2))
def test_motion_leads_there(model: CapsuleModel, seed: int, seconds: float) -> None:
    """From one pose to another; half of the time is half of the way, and none is none."""
    converter, center = PoseConverter(model), np.zeros(3)
    first, second = (converter.world_pose(any_x(model, seed + i), center) for i in range(2))
    motion = motion_between(first, second, seconds)
    there, half, stay = (moved(first, motion, part * seconds) for part in (1, 0.5, 0))
    for found, expected in ((there, second), (stay, first)):
        for one, other in zip(found, expected):
            np.testing.assert_allclose(one, other, atol=1e-4)
    np.testing.assert_allclose(half.place, (first.place + second.place) / 2)
    np.testing.assert_allclose(half.rotation @ first.rotation.T @ half.rotation, second.rotation, atol=1e-4)


def test_how_fast() -> None:
    """A quarter turn about y in half a second, 10 mm along x."""
    first = WorldPose(np.zeros(3), np.eye(3), np.zeros(2))
    second = WorldPose(np.array([10.0, 0, 0]), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), np.array([0, 0.1]))
    motion = motion_between(first, second, 0.5)
    np.testing.assert_allclose(motion.place, [20, 0, 0])
    np.testing.assert_allclose(motion.turn, [0, np.pi, 0], atol=1e-9)
    np.testing.assert_allclose(motion.others, [0, 0.2])
