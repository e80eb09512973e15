"""Skeletons and forward kinematics: a planar arm in closed form, the hand, any pose, and broken skeleton files."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import netlib
from layers import kinematics

# Base at (x, y), upper arm of length 2, fore arm of length 1 along the local x axes, both turning about z.
ARM = """
    name: "arm"
    dof { name: "x" } dof { name: "y" initial: 0.5 }
    dof { name: "shoulder" initial: 0.25 lower: -1 upper: 1 } dof { name: "elbow" lower: 0 upper: 2.5 }
    joint { name: "hand" parent: "elbow" rotate { axis: Z dof: "elbow" } bone { axis: X length: 1 } }
    joint { name: "elbow" parent: "base" rotate { axis: Z dof: "shoulder" } bone { axis: X length: 2 } }
    joint { name: "base" translate { axis: X dof: "x" } translate { axis: Y dof: "y" } }
"""


@pytest.fixture
def skeleton(tmp_path):
    """``skeleton(text)``: the skeleton of a file with this text."""

    def make(text):
        path = tmp_path / f"skeleton{len(list(tmp_path.iterdir()))}.prototxt"
        path.write_text(text)
        return kinematics.load(path)

    return make


def arm(inputs):
    """The closed form: hand, elbow, base."""
    x, y, shoulder, elbow = inputs.T
    y, shoulder = y + 0.5, shoulder + 0.25
    base = np.stack([x, y, 0 * x], axis=1)
    upper = 2 * np.stack([np.cos(shoulder), np.sin(shoulder), 0 * x], axis=1)
    fore = np.stack([np.cos(shoulder + elbow), np.sin(shoulder + elbow), 0 * x], axis=1)
    return np.stack([base + upper + fore, base + upper, base], axis=1)


# ---------------------------------------------------------------------------------------------- the arm


@pytest.mark.parametrize("N", [1, 3, 8, 9, 40])
def test_a_planar_arm_is_its_closed_form(skeleton, rng, N):
    """Joints in file order, though children stand before their parents; for few poses and for many."""
    inputs = rng.normal(size=(N, 4))
    assert np.allclose(skeleton(ARM).joints(inputs), arm(inputs))


def test_the_gradient_of_the_arm_is_that_of_its_closed_form(skeleton, rng):
    """By complex steps, which have no rounding error."""
    inputs, dX = rng.normal(size=(5, 4)), rng.normal(size=(5, 3, 3))
    body = skeleton(ARM)
    got = body.backward(body.forward(inputs), dX.transpose(1, 2, 0))
    for d in range(4):
        moved = inputs.astype(complex)
        moved[:, d] += 1e-30j
        assert np.allclose(got[:, d], (arm(moved).imag / 1e-30 * dX).sum(axis=(1, 2)))


def test_what_a_skeleton_knows(skeleton):
    """Names in file order, limits, offsets, parents, bones."""
    body = skeleton(ARM)
    assert body.name == "arm"
    assert body.dof_names == ["x", "y", "shoulder", "elbow"]
    assert body.joint_names == ["hand", "elbow", "base"]
    assert body.parents.tolist() == [1, 2, -1]
    assert body.bones.tolist() == [1, 2, 0]
    assert body.initial.tolist() == [0, 0.5, 0.25, 0]
    assert body.lower.tolist() == [-np.inf, -np.inf, -1, 0]
    assert not body.fixed.any()


def test_a_fixed_dof_ignores_its_input_and_gets_no_gradient(skeleton, rng):
    """A fixed turn and a fixed shift: the initial value holds."""
    text = ARM.replace("initial: 0.25", "initial: 0.25 fixed: true").replace("initial: 0.5", "initial: 0.5 fixed: true")
    body, inputs = skeleton(text), rng.normal(size=(20, 4))
    still = inputs * [1, 0, 0, 1]
    assert np.allclose(body.joints(inputs), arm(still))
    assert np.allclose(body.joints(inputs[:3]), arm(still[:3]))
    gradient = body.backward(body.forward(inputs), rng.normal(size=(3, 3, 20)))
    assert not gradient[:, 1:3].any()
    assert gradient[:, [0, 3]].all()


def test_a_negative_axis_turns_and_moves_the_other_way(skeleton, rng):
    """About and along -z, -x."""
    inputs = rng.normal(size=(12, 4))
    turned = skeleton(ARM.replace("axis: Z", "axis: NEG_Z").replace("initial: 0.25", "initial: -0.25"))
    assert np.allclose(turned.joints(inputs * [1, 1, -1, -1]), arm(inputs))
    bones = skeleton(ARM.replace("bone { axis: X length: 2 }", "bone { axis: NEG_X length: -2 }"))
    assert np.allclose(bones.joints(inputs), arm(inputs))


def test_one_dof_may_drive_several_joints(skeleton, rng):
    """A coupled finger: elbow and shoulder bend together, the gradient is the sum."""
    body = skeleton(ARM.replace('dof: "elbow"', 'dof: "shoulder"'))
    inputs, dX = rng.normal(size=(10, 4)), rng.normal(size=(3, 3, 10))
    coupled = inputs.copy()
    coupled[:, 3] = inputs[:, 2] + 0.25
    assert np.allclose(body.joints(inputs), arm(coupled))
    plain = skeleton(ARM)
    single = plain.backward(plain.forward(coupled), dX)
    got = body.backward(body.forward(inputs), dX)
    assert np.allclose(got[:, 2], single[:, 2] + single[:, 3])
    assert not got[:, 3].any()


@pytest.mark.parametrize("joints", [None, [2, 0]])
def test_jacobian_against_differences(skeleton, rng, joints):
    """Of turns and translations, of all joints and of some."""
    body, inputs = skeleton(ARM), rng.normal(size=(3, 4))
    chosen = joints or [0, 1, 2]
    J = body.jacobian(body.forward(inputs), joints)
    assert J.shape == (3, len(body.driven), 3 * len(chosen))
    for q, dof in enumerate(body.driven):
        step = np.zeros(4)
        step[dof] = 1e-6
        slope = (body.joints(inputs + step) - body.joints(inputs - step)) / 2e-6
        assert np.allclose(J[:, q], slope[:, chosen].reshape(3, -1), atol=1e-8)


def test_bones_of_every_row(skeleton, rng):
    """Each pose with its own lengths."""
    inputs, body = rng.normal(size=(4, 4)), skeleton(ARM)
    doubled = body.joints(inputs, np.tile(2 * body.bones, (4, 1)))
    base = doubled[:, 2:]
    assert np.allclose(doubled - base, 2 * (arm(inputs) - base))


@pytest.mark.parametrize("name", ["arm", "hand"])
def test_bone_directions_against_differences(skeleton, rng, name):
    """A longer bone moves its joint and all below it that way; a joint without a bone has none."""
    body = skeleton(ARM) if name == "arm" else kinematics.load()
    inputs = rng.normal(size=(3, len(body.initial)))
    directions = body.bone_directions(body.forward(inputs)).transpose(2, 0, 1)
    assert not directions[:, body.bone_axes < 0].any()
    for joint in np.flatnonzero(body.bone_axes >= 0):
        step = 1e-6 * np.eye(len(body.bones))[joint]
        longer, shorter = (body.joints(inputs, np.tile(body.bones + s, (3, 1))) for s in (step, -step))
        slope = (longer - shorter) / 2e-6
        for other in range(len(body.parents)):
            way = [other]
            while body.parents[way[-1]] >= 0:
                way.append(body.parents[way[-1]])
            assert np.allclose(slope[:, other], directions[:, joint] if joint in way else 0, atol=1e-8)


# ---------------------------------------------------------------------------------------------- the hand


@pytest.fixture(scope="module")
def hand():
    """The packaged hand."""
    return kinematics.load()


def test_the_hand_has_26_free_dofs_of_47_and_31_joints(hand):
    """As in the paper."""
    assert (len(hand.dof_names), int((~hand.fixed).sum()), len(hand.joint_names)) == (47, 26, 31)
    assert hand.fixed.nonzero()[0].tolist() == [*range(6, 15), *range(19, 31)]
    assert np.count_nonzero(hand.parents < 0) == 1


def test_one_pose_by_hand(hand):
    """With the palm unturned and every angle 0, the ring finger is a straight line along its metacarpal."""
    angles = -hand.initial[None] * ~hand.fixed
    [joints] = hand.joints(angles)
    names = hand.joint_names
    chain = [joints[names.index(f"ring_{part}")] for part in ("mcp", "base", "pip_a", "pip_b", "dip", "tip")]
    steps = np.diff(np.stack(chain), axis=0)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    assert np.allclose(directions, directions[0])
    assert np.allclose(joints[names.index("palm")], 0)


poses = st.lists(st.floats(-3, 3), min_size=47, max_size=47).map(np.array)


@given(poses)
def test_any_pose_keeps_the_bone_lengths(hand, pose):
    """The reason for the layer: every prediction is a possible hand."""
    for count in (1, 10):  # the ways for few and for many poses
        [joints, *_] = hand.joints(np.tile(pose, (count, 1)))
        inner = hand.parents >= 0
        lengths = np.linalg.norm(joints[inner] - joints[hand.parents[inner]], axis=1)
        assert np.allclose(lengths, np.abs(hand.bones[inner]))


@given(poses, st.tuples(*[st.floats(-2, 2)] * 3))
def test_moving_the_root_moves_all_joints_alike(hand, pose, shift):
    """The first three DoFs are a translation."""
    moved = pose.copy()
    moved[:3] += shift
    assert np.allclose(hand.joints(moved[None]) - hand.joints(pose[None]), shift)


@given(poses, st.floats(-3, 3))
def test_turning_the_root_keeps_all_distances(hand, pose, angle):
    """Between any two joints."""
    turned = pose.copy()
    turned[3:6] += angle
    before, after = hand.joints(np.stack([pose, turned]))
    distances = [np.linalg.norm(X[:, None] - X[None], axis=2) for X in (before, after)]
    assert np.allclose(*distances)


def test_few_poses_and_many_agree(hand, rng):
    """Two ways to compute the same."""
    inputs = rng.normal(size=(20, 47))
    together = hand.joints(inputs)
    assert np.allclose(np.concatenate([hand.joints(inputs[i : i + 3]) for i in range(0, 20, 3)]), together, atol=1e-14)
    assert np.allclose(hand.forward(inputs).joints.transpose(2, 0, 1), together, atol=1e-14)


def test_float32_costs_digits_of_float32_only(hand, rng):
    """Also far away: the body is built around its root, and moved there last."""
    inputs, dX = rng.normal(0, 0.5, (20, 47)).astype(np.float32), rng.normal(size=(31, 3, 20)).astype(np.float32)
    inputs[10:, :3] += 500
    exact, fast = hand.forward(inputs), hand.as_type(np.float32).forward(inputs)
    assert fast.joints.dtype == np.float32
    assert np.allclose(fast.joints[..., :10], exact.joints[..., :10], rtol=0, atol=1e-6)
    assert np.allclose(fast.joints[..., 10:], exact.joints[..., 10:], rtol=0, atol=5e-5)
    gradient = hand.as_type(np.float32).backward(fast, dX)
    assert gradient.dtype == np.float32
    assert np.allclose(gradient, hand.backward(exact, dX), rtol=0, atol=1e-5)


def test_bodies_of_several_roots(skeleton, rng):
    """Each is built around its own root: two arms in one file move as two files of one arm do."""
    arm = """
        dof {{ name: "x{0}" }} dof {{ name: "y{0}" }} dof {{ name: "turn{0}" }} dof {{ name: "elbow{0}" }}
        joint {{ name: "base{0}" translate {{ axis: X dof: "x{0}" }} translate {{ axis: Y dof: "y{0}" }}
                 rotate {{ axis: Z dof: "turn{0}" }} bone {{ axis: X length: 0.2 }} }}
        joint {{ name: "hand{0}" parent: "base{0}" rotate {{ axis: Z dof: "elbow{0}" }} bone {{ axis: X length: 1 }} }}
    """
    one, two = skeleton(arm.format("")), skeleton(arm.format("_a") + arm.format("_b"))
    inputs, dX = rng.normal(size=(20, 8)), rng.normal(size=(4, 3, 20))
    pose, parts = two.forward(inputs), [one.forward(inputs[:, :4]), one.forward(inputs[:, 4:])]
    assert np.allclose(pose.joints, np.concatenate([part.joints for part in parts]))
    gradients = [one.backward(part, dX[2 * i : 2 * i + 2]) for i, part in enumerate(parts)]
    assert np.allclose(two.backward(pose, dX), np.concatenate(gradients, axis=1))


def test_rotation_of_a_joint(hand, rng):
    """A rotation that carries the bone's axis along the bone."""
    inputs = rng.normal(size=(9, 47))
    pose, joint = hand.forward(inputs), hand.joint_names.index("index_dip")
    R = hand.rotation_of(pose, joint)
    assert np.allclose(R @ R.transpose(0, 2, 1), np.eye(3))
    assert np.allclose(np.linalg.det(R), 1)
    joints = pose.joints.transpose(2, 0, 1)
    bone = joints[:, joint] - joints[:, hand.parents[joint]]
    assert np.allclose(R[:, :, 1] * hand.bones[joint], bone)


def test_right_handed_rotations():
    """x to y about z, y to z about x, z to x about y."""
    for axis in range(3):
        R = kinematics.rotation(axis, np.pi / 2)
        assert np.allclose(R @ np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3])


# ---------------------------------------------------------------------------------------------- broken files


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('parent: "base"', 'parent: "bse"', r"prototxt:6:\d+: error: unknown parent 'bse' \(did you mean 'base'\?\)"),
        ('axis: Z dof: "elbow"', 'axis: Z dof: "elbov"', r"prototxt:5:\d+: error: unknown dof 'elbov' \(did you"),
        ('name: "elbow" parent: "base"', 'name: "elbow" parent: "hand"', "is its own ancestor"),
        ('name: "elbow" parent: "base"', 'name: "elbow" parent: "elbow"', "joint 'elbow' is its own ancestor"),
        ('dof { name: "y"', 'dof { name: "x"', "DoF 'x' is defined twice"),
        ('joint { name: "base"', 'joint { name: "hand"', "joint 'hand' is defined twice"),
        ("lower: -1 upper: 1", "lower: 1 upper: -1", "DoF 'shoulder': lower limit 1 is above -1"),
        ("axis: Z", "axis: W", "unknown value W of 'axis'"),
        ("length: 1", "lenght: 1", r"unknown field 'lenght' \(did you mean 'length'\?\)"),
        ("bone { axis: X length: 1 }", "bone { axis: X }", "missing required field 'length' in bone"),
    ],
)  # fmt: skip
def test_mistakes_in_a_skeleton_file(skeleton, old, new, message):
    """At their place, with the nearest known name."""
    assert old in ARM
    with pytest.raises(netlib.PrototxtError, match=message):
        skeleton(ARM.replace(old, new))


@pytest.mark.parametrize("text", ["", 'name: "nobody"', 'dof { name: "x" }'])
def test_a_skeleton_without_joints(skeleton, text):
    """Is a mistake, in one line."""
    with pytest.raises(netlib.NetlibError, match=r"skeleton0.prototxt"):
        skeleton(text)


def test_a_missing_skeleton_file(tmp_path):
    """Is named."""
    with pytest.raises(netlib.NetlibError, match=r"gone\.prototxt: cannot read the prototxt: No such file"):
        kinematics.load(tmp_path / "gone.prototxt")


def test_the_same_relative_name_in_another_folder(tmp_path, monkeypatch):
    """Is another file."""
    for folder, length in (("a", 1), ("b", 3)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "arm.prototxt").write_text(ARM.replace("length: 1 ", f"length: {length} "))
        monkeypatch.chdir(tmp_path / folder)
        assert kinematics.load_for("arm.prototxt", None).bones[0] == length


def test_numbers_that_are_none(tmp_path: Path) -> None:
    """A length or an initial value must be finite."""
    path = tmp_path / "s.prototxt"
    path.write_text('joint { name: "a" bone { axis: X length: nan } }')
    with pytest.raises(netlib.PrototxtError, match=r"s\.prototxt:1:24: error: nan is not a length or an angle"):
        kinematics.load(path)
