"""handpose/fit/body.py: RootMotion, compared with the kinematics, for roots of every
kind; and WorldPose
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from handpose.fit.body import (
    SIZE_INDEX,
    CapsuleModel,
    RootMotion,
    WorldPose,
    crop_variables,
    world_pose,
)
from layers.hand.bodies import kinematics_of
from tests.support.made_tracks import skeleton_of

# A body of three joints; {slides} and {turns} are the motions of its root, which have
# initial values.
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


def body(
    slides: str = "X Y Z", turns: str = "Z X Y", z: str = "", angles: str = "abc"
) -> CapsuleModel:
    """A body whose root has these axes, which may be negative, such as NEG_X."""

    def motions(kind: str, axes: str, names: str) -> str:
        pairs = zip(axes.split(), names)
        return " ".join(f'{kind} {{ axis: {axis} dof: "{name}" }}' for axis, name in pairs)

    moves, spins = motions("translate", slides, "xyz"), motions("rotate", turns, angles)
    return CapsuleModel(skeleton_of(BODY.format(slides=moves, turns=spins, z=z)), 150.0)


ROOTS = [
    *(body(turns=" ".join(order)) for order in itertools.permutations("XYZ")),
    body("NEG_X Y NEG_Z", "NEG_Z X NEG_Y"),
    body("Z NEG_X Y", "Y NEG_Z NEG_X"),
]


@pytest.mark.parametrize(
    "made", [None, *ROOTS], ids=["hand", *(str(RootMotion(made)._axes) for made in ROOTS)]
)
def test_place_and_rotation_there_and_back(model: CapsuleModel, made: CapsuleModel | None) -> None:
    """Both are the root joint's, for any order and sign of its axes, and convert back, also where
    two axes coincide.
    """
    own = made or model
    kinematics, root = kinematics_of(own.skeleton), RootMotion(own)
    x = np.random.default_rng(1).uniform(-1, 1, (30, own.variables))
    x[:, own.root] *= 4  # angles in all directions
    x[:, SIZE_INDEX] = 0
    pose = kinematics.forward(own.inputs_of(x))
    joint = int(np.flatnonzero(own.skeleton.parents < 0)[0])
    assert_allclose(root.place(x), pose.joints[:, joint] * 150)
    assert_allclose(root.rotation(x), kinematics.rotation_of(pose, joint), atol=1e-12)
    # of all bodies here
    poles = np.add.outer((0.5 * np.pi, 1.5 * np.pi, -0.5 * np.pi), (0.4, -0.4, 0.0))
    for middle in (x[:, root.columns[4]], *poles.ravel()):
        x[:, root.columns[4]] = middle
        again = x.copy()
        again[:, root.columns] = root.variables(root.place(x), root.rotation(x))
        assert_allclose(own.joints(again), own.joints(x), atol=1e-3)
        assert (np.abs(again[:, root.columns[3:]]) <= np.pi).all()


CENTERS = st.tuples(*(st.floats(-500, 500),) * 3)


@given(seed=st.integers(0, 10**6), first=CENTERS, second=CENTERS)
def test_any_crop_centre(
    model: CapsuleModel, seed: int, first: tuple[float, ...], second: tuple[float, ...]
) -> None:
    """Any pose of the hand is converted between any two centres: its joints in space
    stay the same.
    """
    x = np.random.default_rng(seed).uniform(-1, 1, model.variables)
    x[model.root] *= 4
    again = crop_variables(model, world_pose(model, x, np.array(first)), np.array(second))
    before, after = model.joints(np.stack([x, again]))
    assert_allclose(after + second, before + first, atol=1e-3)
    others = model.root_motion.others
    assert_array_equal(again[others], x[others])


@given(seed=st.integers(0, 10**6), angle=st.floats(0, np.pi))
def test_a_step_and_its_inverse_restore_the_pose(seed: int, angle: float) -> None:
    """A step is the change of the place, a rotation about an axis of the world, and the change of
    the other variables.
    """
    rng = np.random.default_rng(seed)
    step = rng.normal(size=10)
    step[3:6] *= angle / np.linalg.norm(step[3:6])
    rotation = Rotation.random(random_state=rng).as_matrix()
    first = WorldPose(rng.normal(size=3), rotation, rng.normal(size=4))
    second = first.moved(step)
    assert_allclose(second.place, first.place + step[:3])
    turned = Rotation.from_rotvec(step[3:6]).as_matrix() @ rotation
    assert_allclose(second.rotation, turned, atol=1e-9)
    assert_allclose(second.others, first.others + step[6:])
    back = first.step_to(second)
    assert np.linalg.norm(back[3:6]) <= np.pi + 1e-9
    for found, expected in zip(first.moved(back), second):
        assert_allclose(found, expected, atol=1e-5)


def test_a_step_by_hand() -> None:
    """10 mm along x and a quarter turn about y."""
    first = WorldPose(np.zeros(3), np.eye(3), np.zeros(2))
    quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    second = WorldPose(np.array([10.0, 0, 0]), quarter, np.array([0, 0.1]))
    expected = [10, 0, 0, 0, np.pi / 2, 0, 0, 0.1]
    assert_allclose(first.step_to(second), expected, atol=1e-9)
