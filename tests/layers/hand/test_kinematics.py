"""Forward kinematics and its gradient for a planar arm in closed form, for the hand
and for any pose.
"""

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layers.hand.bodies import kinematics_of
from layers.hand.kinematics import Kinematics, rotation
from layers.hand.skeleton import load

HAND = load()
STEP = 1e-6  # of central differences
COMPLEX_STEP = 1e-30
ARM_ALONG_X = np.array([[0.0, -0.5, -0.25, 0.0]])  # inputs that cancel the arm's initial values


def slope_along(direction, function, x):
    """The derivative of ``function`` at x along a direction, by central differences."""
    step = STEP * direction
    return (function(x + step) - function(x - step)) / (2 * STEP)


@pytest.fixture
def body(skeleton):
    """``body(text)`` returns the kinematics of a skeleton file with this text, in the
    engine in use.
    """
    return lambda text: kinematics_of(skeleton(text))


@pytest.fixture(scope="module")
def hand(engine_in_use):
    """The kinematics of the packaged hand."""
    return kinematics_of(HAND)


@pytest.mark.parametrize("N", [1, 3, 8, 9, 40])
def test_a_planar_arm_is_its_closed_form(body, arm_text, arm, rng, N):
    """Joints are in file order, even if children precede their parents, for few
    poses and for many.
    """
    inputs = rng.normal(size=(N, 4))
    assert np.allclose(body(arm_text).joints(inputs), arm(inputs))


def test_the_gradient_of_the_arm_is_that_of_its_closed_form(body, arm_text, arm, rng):
    """The gradient agrees with complex-step differences, which have no rounding error."""
    inputs, dX = rng.normal(size=(5, 4)), rng.normal(size=(5, 3, 3))
    kinematics = body(arm_text)
    gradient = kinematics.backward(kinematics.forward(inputs), dX)
    for dof in range(4):
        moved = inputs.astype(complex)
        moved[:, dof] += 1j * COMPLEX_STEP
        slope = arm(moved).imag / COMPLEX_STEP
        assert np.allclose(gradient[:, dof], (slope * dX).sum(axis=(1, 2)))


def test_force_and_torque_on_numbers_worked_by_hand(body, arm_text):
    """For the arm stretched along x, an upward force f at the hand exerts 3 f on the shoulder and
    f on the elbow.
    """
    kinematics = body(arm_text)
    pose = kinematics.forward(ARM_ALONG_X)
    assert np.allclose(pose.joints[0], [[3, 0, 0], [2, 0, 0], [0, 0, 0]])
    dX = np.zeros((1, 3, 3))
    # the base translates by the force (7, 5); the component along the arm has no torque
    dX[0, 0] = (7, 5, 0)
    assert np.allclose(kinematics.backward(pose, dX), [[7, 5, 15, 5]])


def test_a_fixed_dof_ignores_its_input_and_gets_no_gradient(body, arm_text, arm, rng):
    text = arm_text.replace("initial: 0.25", "initial: 0.25 fixed: true")
    text = text.replace("initial: 0.5", "initial: 0.5 fixed: true")
    kinematics = body(text)
    inputs = rng.normal(size=(20, 4))
    expected = arm(inputs * [1, 0, 0, 1])
    assert np.allclose(kinematics.joints(inputs), expected)
    assert np.allclose(kinematics.joints(inputs[:3]), expected[:3])
    gradient = kinematics.backward(kinematics.forward(inputs), rng.normal(size=(20, 3, 3)))
    assert not gradient[:, 1:3].any()
    assert gradient[:, [0, 3]].all()


def test_a_negative_axis_turns_and_moves_the_other_way(body, arm_text, arm, rng):
    inputs = rng.normal(size=(12, 4))
    text = arm_text.replace("axis: Z", "axis: NEG_Z").replace("initial: 0.25", "initial: -0.25")
    assert np.allclose(body(text).joints(inputs * [1, 1, -1, -1]), arm(inputs))
    text = arm_text.replace("bone { axis: X length: 2 }", "bone { axis: NEG_X length: -2 }")
    assert np.allclose(body(text).joints(inputs), arm(inputs))


def test_one_dof_may_drive_several_joints(body, arm_text, arm, rng):
    """If one DoF drives elbow and shoulder, its gradient is the sum of both gradients."""
    coupled = body(arm_text.replace('dof: "elbow"', 'dof: "shoulder"'))
    free = body(arm_text)
    inputs, dX = rng.normal(size=(10, 4)), rng.normal(size=(10, 3, 3))
    free_inputs = inputs.copy()
    free_inputs[:, 3] = inputs[:, 2] + 0.25
    assert np.allclose(coupled.joints(inputs), arm(free_inputs))
    free_gradient = free.backward(free.forward(free_inputs), dX)
    gradient = coupled.backward(coupled.forward(inputs), dX)
    assert np.allclose(gradient[:, 2], free_gradient[:, 2] + free_gradient[:, 3])
    assert not gradient[:, 3].any()


@pytest.mark.parametrize("fixed", ["", "fixed: true"])
@pytest.mark.parametrize("joints", [None, [2, 0]])
def test_jacobian_against_differences(body, arm_text, rng, joints, fixed):
    """The Jacobian of all joints or of some agrees with differences; a fixed motion has no row."""
    kinematics = body(arm_text.replace("initial: 0.5", f"initial: 0.5 {fixed}"))
    inputs = rng.normal(size=(3, 4))
    chosen = joints or [0, 1, 2]
    J = kinematics.jacobian(kinematics.forward(inputs), joints)
    assert J.shape == (3, 3 if fixed else 4, 3 * len(chosen))
    for row, dof in enumerate(kinematics.skeleton.driven):
        slope = slope_along(np.eye(4)[dof], kinematics.joints, inputs)
        assert np.allclose(J[:, row], slope[:, chosen].reshape(3, -1), atol=1e-8)


def descendants(skeleton, joint):
    """Return for each joint whether it is ``joint`` or descends from it."""
    parents = skeleton.parents
    found = np.arange(len(parents)) == joint
    for _ in parents:
        found |= (parents >= 0) & found[parents]
    return found


@pytest.mark.parametrize("name", ["arm", "hand"])
def test_bone_directions_against_differences(body, arm_text, hand, rng, name):
    """A longer bone moves its joint and all descendants along the bone direction; joints without a
    bone have none.
    """
    kinematics = body(arm_text) if name == "arm" else hand
    skeleton = kinematics.skeleton
    inputs = rng.normal(size=(3, len(skeleton.initial)))
    bones = np.tile(skeleton.bones, (3, 1))
    directions = kinematics.bone_directions(kinematics.forward(inputs))
    has_bone = skeleton.bone_axes >= 0
    assert not directions[:, ~has_bone].any()
    joints_of = functools.partial(kinematics.joints, inputs)
    for joint in np.flatnonzero(has_bone):
        slope = slope_along(np.eye(len(has_bone))[joint], joints_of, bones)
        moves = descendants(skeleton, joint)
        assert np.allclose(slope[:, moves], directions[:, [joint]], atol=1e-8)
        assert np.allclose(slope[:, ~moves], 0, atol=1e-8)


@pytest.mark.parametrize("N", [1, 40])
def test_the_gradient_of_bones(body, any_body, rng, N):
    """The gradient of each pose's bone lengths agrees with differences; it is 0 for joints
    without a bone.
    """
    kinematics = body(any_body)
    skeleton = kinematics.skeleton
    inputs, dX = rng.normal(size=(N, 6)), rng.normal(size=(N, 6, 3))
    bones = skeleton.bones * rng.uniform(-2, 2, (N, 6))
    gradient = kinematics.backward_bones(kinematics.forward(inputs, bones), dX)
    has_bone = skeleton.bone_axes >= 0
    joints_of = functools.partial(kinematics.joints, inputs)
    for joint, direction in enumerate(np.diag(has_bone)):
        slope = slope_along(direction, joints_of, bones)
        assert np.allclose(gradient[:, joint], (slope * dX).sum(axis=(1, 2)), atol=1e-7)


def test_the_force_along_a_bone_worked_by_hand(body, arm_text):
    """For the arm stretched along x, the upper arm's gradient sums elbow and hand, the forearm's
    only the hand.
    """
    kinematics = body(arm_text)
    pose = kinematics.forward(ARM_ALONG_X)
    dX = np.array([[[2.0, 9, 0], [3, 9, 0], [100, 9, 0]]])  # at hand, elbow, base
    assert np.allclose(kinematics.backward_bones(pose, dX), [[2, 5, 0]])


def test_one_pose_by_hand(hand):
    """With the palm unrotated and all angles 0, the ring finger is a straight line along
    its metacarpal.
    """
    [joints] = hand.joints(-HAND.initial[None] * ~HAND.fixed)
    names = HAND.joint_names
    parts = ("mcp", "base", "pip_a", "pip_b", "dip", "tip")
    ring = joints[[names.index(f"ring_{part}") for part in parts]]
    segments = np.diff(ring, axis=0)
    directions = segments / np.linalg.norm(segments, axis=1, keepdims=True)
    assert np.allclose(directions, directions[0])
    assert np.allclose(joints[names.index("palm")], 0)


poses = st.lists(st.floats(-3, 3), min_size=47, max_size=47).map(np.array)


@given(poses)
def test_any_pose_keeps_the_bone_lengths(hand, pose):
    """Any pose keeps the bone lengths, so every prediction is a possible hand."""
    inner = HAND.parents >= 0
    for N in (1, 20):  # few and many poses are computed differently
        [joints, *_] = hand.joints(np.tile(pose, (N, 1)))
        lengths = np.linalg.norm(joints[inner] - joints[HAND.parents[inner]], axis=1)
        assert np.allclose(lengths, np.abs(HAND.bones[inner]))


def test_float32_costs_digits_of_float32_only(hand, rng):
    """float32 loses only float32 precision, even far from the origin, as torques are computed
    about local points.
    """
    inputs = rng.normal(0, 0.5, (20, 47)).astype(np.float32)
    near, far = slice(0, 10), slice(10, 20)
    inputs[far, :3] += 500
    dX = rng.normal(size=(20, 31, 3)).astype(np.float32)
    single = kinematics_of(HAND, np.float32)
    pose, expected = single.forward(inputs), hand.forward(inputs)
    assert single.joints(inputs).dtype == np.float32
    assert np.allclose(pose.joints[near], expected.joints[near], rtol=0, atol=1e-6)
    assert np.allclose(pose.joints[far], expected.joints[far], rtol=0, atol=5e-5)
    gradient = single.backward(pose, dX)
    assert gradient.dtype == np.float32
    assert np.allclose(gradient, hand.backward(expected, dX), rtol=0, atol=1e-5)


@pytest.mark.parametrize("N", [3, 20])
def test_several_roots_agree_with_their_closed_form(body, rng, N):
    """Bodies with equal roots and with a root that does not rotate agree with their closed form."""
    text = """
        dof { name: "u" } dof { name: "v" } dof { name: "w" }
        joint { name: "left" rotate { axis: Z dof: "u" } bone { axis: X length: 0.5 } }
        joint { name: "right" rotate { axis: Z dof: "v" } bone { axis: X length: 0.5 } }
        joint { name: "still" bone { axis: X length: 0.7 } }
        joint { name: "hand" parent: "right" rotate { axis: Z dof: "w" } bone { axis: X length: 0.3 } }
    """
    kinematics = body(text)
    u, v, w = rng.normal(size=(3, N))
    pose = kinematics.forward(np.stack([u, v, w], axis=1))
    angles = np.stack([u, v, np.zeros(N), v + w], axis=1)
    x_axes = np.stack([np.cos(angles), np.sin(angles), np.zeros((N, 4))], axis=2)
    expected = x_axes * [[0.5], [0.5], [0.7], [0.3]]
    expected[:, 3] += expected[:, 1]
    assert np.allclose(pose.joints, expected)
    for joint in range(4):
        assert np.allclose(kinematics.rotation_of(pose, joint)[..., 0], x_axes[:, joint])


def test_a_body_without_free_motions(body):
    kinematics = body(
        'dof { name: "u" fixed: true } joint { name: "a" rotate { axis: Z dof: "u" } bone { axis: X length: 1 } }'
    )
    assert kinematics.jacobian(kinematics.forward(np.zeros((3, 1)))).shape == (3, 0, 3)


def test_rotations():
    """Rotation about z maps x to y, about x maps y to z and about y maps z to x, for one
    angle or many.
    """
    for axis in range(3):
        R = rotation(axis, np.pi / 2)
        assert np.allclose(R @ np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3])
        many = rotation(axis, np.array([[0.3, -2.0]]))
        assert many.shape == (1, 2, 3, 3)
        assert np.allclose(many[0, 1], rotation(axis, -2.0))


@pytest.mark.parametrize("N", [1, 4, 40])
@pytest.mark.parametrize("own", [False, True], ids=["packaged bones", "own bones"])
def test_forward_pose_is_a_pose(rng, N, own):
    """Joints, axes, pivots and rotations equal those of the plain engine, with the skeleton's or
    each pose's bones.
    """
    skeleton = HAND.with_surface()
    kinematics, plain = kinematics_of(skeleton), Kinematics(skeleton)
    inputs = rng.normal(0, 0.5, (N, len(skeleton.initial)))
    bones = None
    if own:
        bones = skeleton.bones * rng.uniform(0.8, 1.2, (N, len(skeleton.bones)))
    pose, expected = kinematics.forward_pose(inputs, bones), plain.forward(inputs, bones)
    assert np.allclose(pose.joints, expected.joints)
    axis, pivot = kinematics.axes(pose)
    assert np.allclose(axis, expected.axis)
    # any point on the axis may be the pivot
    offset = np.cross(pivot - expected.pivot, expected.axis)
    assert np.allclose(offset[:, skeleton.turns], 0, atol=1e-12)
    names = skeleton.joint_names
    for joint in (0, names.index("palm"), len(names) - 1):
        found = kinematics.rotation_of(pose, joint)
        assert np.allclose(found, plain.rotation_of(expected, joint))
    for joints in (None, [3, 0]):
        J = kinematics.jacobian(pose, joints)
        assert np.allclose(J, plain.jacobian(expected, joints))
