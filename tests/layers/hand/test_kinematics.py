"""Forward kinematics and its gradient for a planar arm in closed form, for the hand
and for any pose.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layers.hand.bodies import kinematics_of
from layers.hand.kinematics import Kinematics, rotation
from layers.hand.skeleton import load

HAND = load()


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
    made = body(arm_text)
    got = made.backward(made.forward(inputs), dX)
    for d in range(4):
        moved = inputs.astype(complex)
        moved[:, d] += 1e-30j
        assert np.allclose(got[:, d], (arm(moved).imag / 1e-30 * dX).sum(axis=(1, 2)))


def test_force_and_torque_on_numbers_worked_by_hand(body, arm_text):
    """For the arm stretched along x, an upward force f at the hand exerts 3 f on the shoulder and
    f on the elbow.
    """
    made = body(arm_text)
    pose = made.forward(np.array([[0.0, -0.5, -0.25, 0.0]]))
    assert np.allclose(pose.joints[0], [[3, 0, 0], [2, 0, 0], [0, 0, 0]])
    dX = np.zeros((1, 3, 3))
    # the base translates by the force (7, 5); the component along the arm has no torque
    dX[0, 0] = (7, 5, 0)
    assert np.allclose(made.backward(pose, dX), [[7, 5, 15, 5]])


def test_a_fixed_dof_ignores_its_input_and_gets_no_gradient(body, arm_text, arm, rng):
    text = arm_text.replace("initial: 0.25", "initial: 0.25 fixed: true")
    text = text.replace("initial: 0.5", "initial: 0.5 fixed: true")
    made, inputs = body(text), rng.normal(size=(20, 4))
    still = inputs * [1, 0, 0, 1]
    assert np.allclose(made.joints(inputs), arm(still))
    assert np.allclose(made.joints(inputs[:3]), arm(still[:3]))
    gradient = made.backward(made.forward(inputs), rng.normal(size=(20, 3, 3)))
    assert not gradient[:, 1:3].any()
    assert gradient[:, [0, 3]].all()


def test_a_negative_axis_turns_and_moves_the_other_way(body, arm_text, arm, rng):
    inputs = rng.normal(size=(12, 4))
    turned = body(
        arm_text.replace("axis: Z", "axis: NEG_Z").replace("initial: 0.25", "initial: -0.25")
    )
    assert np.allclose(turned.joints(inputs * [1, 1, -1, -1]), arm(inputs))
    bones = body(arm_text.replace("bone { axis: X length: 2 }", "bone { axis: NEG_X length: -2 }"))
    assert np.allclose(bones.joints(inputs), arm(inputs))


def test_one_dof_may_drive_several_joints(body, arm_text, arm, rng):
    """If one DoF drives elbow and shoulder, its gradient is the sum of both gradients."""
    coupled, free = body(arm_text.replace('dof: "elbow"', 'dof: "shoulder"')), body(arm_text)
    inputs, dX = rng.normal(size=(10, 4)), rng.normal(size=(10, 3, 3))
    both = inputs.copy()
    both[:, 3] = inputs[:, 2] + 0.25
    assert np.allclose(coupled.joints(inputs), arm(both))
    single = free.backward(free.forward(both), dX)
    got = coupled.backward(coupled.forward(inputs), dX)
    assert np.allclose(got[:, 2], single[:, 2] + single[:, 3])
    assert not got[:, 3].any()


@pytest.mark.parametrize("fixed", ["", "fixed: true"])
@pytest.mark.parametrize("joints", [None, [2, 0]])
def test_jacobian_against_differences(body, arm_text, rng, joints, fixed):
    """The Jacobian of all joints or of some agrees with differences; a fixed motion has no row."""
    made = body(arm_text.replace("initial: 0.5", f"initial: 0.5 {fixed}"))
    inputs = rng.normal(size=(3, 4))
    chosen = joints or [0, 1, 2]
    J = made.jacobian(made.forward(inputs), joints)
    assert J.shape == (3, 3 if fixed else 4, 3 * len(chosen))
    for q, dof in enumerate(made.skeleton.driven):
        step = np.zeros(4)
        step[dof] = 1e-6
        slope = (made.joints(inputs + step) - made.joints(inputs - step)) / 2e-6
        assert np.allclose(J[:, q], slope[:, chosen].reshape(3, -1), atol=1e-8)


@pytest.mark.parametrize("name", ["arm", "hand"])
def test_bone_directions_against_differences(body, arm_text, hand, rng, name):
    """A longer bone moves its joint and all descendants along the bone direction; joints without a
    bone have none.
    """
    made = body(arm_text) if name == "arm" else hand
    table = made.skeleton
    inputs = rng.normal(size=(3, len(table.initial)))
    directions = made.bone_directions(made.forward(inputs))
    assert not directions[:, table.bone_axes < 0].any()
    for joint in np.flatnonzero(table.bone_axes >= 0):
        step = 1e-6 * np.eye(len(table.bones))[joint]
        longer, shorter = (
            made.joints(inputs, np.tile(table.bones + s, (3, 1))) for s in (step, -step)
        )
        slope = (longer - shorter) / 2e-6
        for other in range(len(table.parents)):
            way = [other]
            while table.parents[way[-1]] >= 0:
                way.append(table.parents[way[-1]])
            assert np.allclose(
                slope[:, other], directions[:, joint] if joint in way else 0, atol=1e-8
            )


@pytest.mark.parametrize("N", [1, 40])
def test_the_gradient_of_bones(body, any_body, rng, N):
    """The gradient of each pose's bone lengths agrees with differences; it is 0 for joints
    without a bone.
    """
    made = body(any_body)
    table = made.skeleton
    inputs, dX = rng.normal(size=(N, 6)), rng.normal(size=(N, 6, 3))
    bones = table.bones * rng.uniform(-2, 2, (N, 6))
    got = made.backward_bones(made.forward(inputs, bones), dX)
    for k in range(6):
        step = 1e-6 * np.eye(6)[k] * (table.bone_axes[k] >= 0)
        slope = (made.joints(inputs, bones + step) - made.joints(inputs, bones - step)) / 2e-6
        assert np.allclose(got[:, k], (slope * dX).sum(axis=(1, 2)), atol=1e-7)


def test_the_force_along_a_bone_worked_by_hand(body, arm_text):
    """For the arm stretched along x, the upper arm's gradient sums elbow and hand, the forearm's
    only the hand.
    """
    made = body(arm_text)
    pose = made.forward(np.array([[0.0, -0.5, -0.25, 0.0]]))
    dX = np.array([[[2.0, 9, 0], [3, 9, 0], [100, 9, 0]]])  # at hand, elbow, base
    assert np.allclose(made.backward_bones(pose, dX), [[2, 5, 0]])


def test_one_pose_by_hand(hand):
    """With the palm unrotated and all angles 0, the ring finger is a straight line along
    its metacarpal.
    """
    [joints] = hand.joints(-HAND.initial[None] * ~HAND.fixed)
    names = HAND.joint_names
    chain = [
        joints[names.index(f"ring_{part}")]
        for part in ("mcp", "base", "pip_a", "pip_b", "dip", "tip")
    ]
    steps = np.diff(np.stack(chain), axis=0)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    assert np.allclose(directions, directions[0])
    assert np.allclose(joints[names.index("palm")], 0)


poses = st.lists(st.floats(-3, 3), min_size=47, max_size=47).map(np.array)


@given(poses)
def test_any_pose_keeps_the_bone_lengths(hand, pose):
    """Any pose keeps the bone lengths, so every prediction is a possible hand."""
    for count in (1, 20):  # few and many poses are computed differently
        [joints, *_] = hand.joints(np.tile(pose, (count, 1)))
        inner = HAND.parents >= 0
        lengths = np.linalg.norm(joints[inner] - joints[HAND.parents[inner]], axis=1)
        assert np.allclose(lengths, np.abs(HAND.bones[inner]))


def test_float32_costs_digits_of_float32_only(hand, rng):
    """float32 loses only float32 precision, even far from the origin, as torques are computed
    about local points.
    """
    inputs = rng.normal(0, 0.5, (20, 47)).astype(np.float32)
    dX = rng.normal(size=(20, 31, 3)).astype(np.float32)
    inputs[10:, :3] += 500
    single = kinematics_of(HAND, np.float32)
    exact, pose = hand.forward(inputs), single.forward(inputs)
    assert single.joints(inputs).dtype == np.float32
    assert np.allclose(pose.joints[:10], exact.joints[:10], rtol=0, atol=1e-6)
    assert np.allclose(pose.joints[10:], exact.joints[10:], rtol=0, atol=5e-5)
    gradient = single.backward(pose, dX)
    assert gradient.dtype == np.float32
    assert np.allclose(gradient, hand.backward(exact, dX), rtol=0, atol=1e-5)


@pytest.mark.parametrize("N", [3, 20])
def test_a_body_of_which_one_root_has_a_child(body, rng, N):
    """Bodies with equal roots and with a root that does not rotate agree with their closed form."""
    of = """
        dof { name: "u" } dof { name: "v" } dof { name: "w" }
        joint { name: "left" rotate { axis: Z dof: "u" } bone { axis: X length: 0.5 } }
        joint { name: "right" rotate { axis: Z dof: "v" } bone { axis: X length: 0.5 } }
        joint { name: "still" bone { axis: X length: 0.7 } }
        joint { name: "hand" parent: "right" rotate { axis: Z dof: "w" } bone { axis: X length: 0.3 } }
    """
    made, (u, v, w) = body(of), rng.normal(size=(3, N))
    pose, zero = made.forward(np.stack([u, v, w], axis=1)), np.zeros(N)
    left = np.stack([np.cos(u), np.sin(u), zero], axis=1) / 2
    right = np.stack([np.cos(v), np.sin(v), zero], axis=1) / 2
    hand = right + 0.3 * np.stack([np.cos(v + w), np.sin(v + w), zero], axis=1)
    still = np.broadcast_to([0.7, 0, 0], (N, 3))
    assert np.allclose(pose.joints, np.stack([left, right, still, hand], axis=1))
    for j, angle in enumerate((u, v, zero, v + w)):
        x = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        assert np.allclose(made.rotation_of(pose, j)[:, :2, 0], x)


def test_a_body_without_free_motions(body):
    made = body(
        'dof { name: "u" fixed: true } joint { name: "a" rotate { axis: Z dof: "u" } bone { axis: X length: 1 } }'
    )
    assert made.jacobian(made.forward(np.zeros((3, 1)))).shape == (3, 0, 3)


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
    made, plain = kinematics_of(skeleton), Kinematics(skeleton)
    inputs = rng.normal(0, 0.5, (N, len(skeleton.initial)))
    bones = skeleton.bones * rng.uniform(0.8, 1.2, (N, len(skeleton.bones))) if own else None
    found, expected = made.forward_pose(inputs, bones), plain.forward(inputs, bones)
    assert np.allclose(found.joints, expected.joints)
    axis, pivot = made.axes(found)
    assert np.allclose(axis, expected.axis)
    # any point on the axis may be the pivot
    apart = np.cross(pivot - expected.pivot, expected.axis)[:, skeleton.turns]
    assert np.allclose(apart, 0, atol=1e-12)
    for joint in (0, skeleton.joint_names.index("palm"), len(skeleton.joint_names) - 1):
        assert np.allclose(made.rotation_of(found, joint), plain.rotation_of(expected, joint))
    few = [3, 0]
    assert np.allclose(made.jacobian(found), plain.jacobian(expected))
    assert np.allclose(made.jacobian(found, few), plain.jacobian(expected, few))
