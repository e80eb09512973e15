"""handpose/body/joint_formats/formats.py and angles.py"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from posed_hands import MIRROR, PEOPLE, any_pose, right_hand

from handpose.body.joint_formats.angles import ANGLES, anatomical_angles, turned
from handpose.body.joint_formats.formats import FORMATS, FormatName, formatted
from handpose.body.joint_formats.frames import LONG_FINGERS
from handpose.body.nyu import EVALUATION_JOINTS
from handpose.frames.cameras import KINECT2
from netlib.blob import Array


def test_orders() -> None:
    assert [list(FORMATS["mediapipe"].joints)[i] for i in (0, 1, 4, 5, 8, 17, 20)] == [
        "WRIST",
        "THUMB_CMC",
        "THUMB_TIP",
        "INDEX_FINGER_MCP",
        "INDEX_FINGER_TIP",
        "PINKY_MCP",
        "PINKY_TIP",
    ]
    assert [list(FORMATS["mano"].joints)[i] for i in (0, 1, 4, 7, 10, 13, 15, 16, 20)] == [
        "wrist",
        "index1",
        "middle1",
        "pinky1",
        "ring1",
        "thumb1",
        "thumb3",
        "thumb_tip",
        "pinky_tip",
    ]
    assert {name: len(one.joints) for name, one in FORMATS.items()} == {
        "mediapipe": 21,
        "mano": 21,
        "nyu": 14,
    }


@pytest.mark.parametrize("name", FORMATS)
def test_bones_are_pairs_of_joints(name: FormatName) -> None:
    joints = set(FORMATS[name].joints)
    bones = FORMATS[name].bones
    assert {joint for bone in bones for joint in bone} == joints
    assert len(bones) >= len(joints) - 1


def test_the_nyu_format_has_the_evaluation_joints(rng: np.random.Generator) -> None:
    joints = right_hand(any_pose(rng))
    assert np.array_equal(
        formatted("nyu", PEOPLE, "right", joints).positions, joints[list(EVALUATION_JOINTS)]
    )


def test_axes_and_units(rng: np.random.Generator) -> None:
    """A hand at x 100, y 50, z 500 mm, in metres: y points down."""
    joints = np.broadcast_to([100.0, 50.0, 500.0], (31, 3)) + 1e-3 * right_hand(any_pose(rng))
    for name in ("mediapipe", "mano"):
        found = formatted(name, PEOPLE, "right", joints).positions  # type: ignore[arg-type]
        assert np.abs(found - (0.1, -0.05, 0.5)).max() < 2e-3


def test_landmarks_in_the_image() -> None:
    joints = right_hand(any_pose(np.random.default_rng(3)))
    found = formatted("mediapipe", PEOPLE, "right", joints, KINECT2)
    assert found.landmarks is not None
    metric = found.positions * [1000, -1000, 1000]
    u, v, _ = KINECT2.project(metric).T
    assert np.allclose(found.landmarks[:, 0] * 512 - 0.5, u)
    assert np.allclose(found.landmarks[:, 1] * 424 - 0.5, v)
    assert found.landmarks[0, 2] == 0
    behind = metric[:, 2] - metric[0, 2]
    assert np.allclose(found.landmarks[:, 2], behind * KINECT2.fx / metric[0, 2] / 512)


def test_landmarks_without_an_image() -> None:
    """In a crop landmarks are fractions of the cube; without a cube or an image size
    there are none.
    """
    joints = right_hand(any_pose(np.random.default_rng(3))) - [0, 0, 500]
    found = formatted("mediapipe", PEOPLE, "right", joints, cube_mm=300.0).landmarks
    assert found is not None
    expected = formatted("mediapipe", PEOPLE, "right", joints).positions
    assert np.allclose(found[:, :2] * 300, expected[:, :2] * 1000 + 150)
    assert formatted("mediapipe", PEOPLE, "right", joints).landmarks is None
    own = dataclasses.replace(KINECT2, width=0, height=0)
    assert formatted("mediapipe", PEOPLE, "right", joints, own).landmarks is None


@pytest.mark.parametrize("name", FORMATS)
def test_a_left_hand_is_the_mirror_image(name: FormatName) -> None:
    """Positions and landmarks are those of the mirrored right hand."""
    joints = right_hand(any_pose(np.random.default_rng(2)))
    mirrored = dataclasses.replace(KINECT2, u0=KINECT2.width - 1 - KINECT2.u0)
    right = formatted(name, PEOPLE, "right", joints, KINECT2)
    left = formatted(name, PEOPLE, "left", joints * MIRROR, mirrored)
    assert np.allclose(left.positions, right.positions * MIRROR)
    if right.landmarks is not None and left.landmarks is not None:
        assert np.allclose(left.landmarks, right.landmarks * [-1, 1, 1] + [1, 0, 0])


def angles(inputs: Array) -> dict[str, float]:
    """The anatomical angles of a right hand."""
    return anatomical_angles(PEOPLE, "right", right_hand(inputs))


def with_dof(name: str, value: float) -> Array:
    """The initial pose with one input changed."""
    inputs = np.zeros(len(PEOPLE.initial))
    inputs[PEOPLE.dof_names.index(name)] = value
    return inputs


@pytest.mark.parametrize("seed", range(5))
def test_hinge_angles_equal_the_models(seed: int) -> None:
    """PIP, DIP and the thumb's hinges equal the model's angles in any pose and place, in degrees,
    up to the sign.
    """
    inputs = any_pose(np.random.default_rng(seed))
    theta = dict(zip(PEOPLE.dof_names, np.degrees(PEOPLE.theta(inputs[None])[0])))
    found = angles(inputs)
    for finger in LONG_FINGERS:
        assert found[f"{finger}_pip_flexion"] == pytest.approx(
            -theta[f"{finger}_pip_rot_x"], abs=1e-6
        )
        assert found[f"{finger}_dip_flexion"] == pytest.approx(
            -theta[f"{finger}_dip_rot_x"], abs=1e-6
        )
    assert found["thumb_mcp_flexion"] == pytest.approx(theta["thumb_dip_rot_z"], abs=1e-6)
    assert found["thumb_ip_flexion"] == pytest.approx(theta["thumb_tip_rot_z"], abs=1e-6)


@pytest.mark.parametrize("finger", LONG_FINGERS)
@pytest.mark.parametrize("spread", ["lower", "upper"])
def test_a_closed_finger(finger: str, spread: str) -> None:
    """At the limits a finger is bent by 90, 110 and 80 degrees, also if its first phalanx
    points backwards.
    """
    inputs = np.zeros(len(PEOPLE.initial))
    for joint in ("base", "pip", "dip"):
        d = PEOPLE.dof_names.index(f"{finger}_{joint}_rot_x")
        inputs[d] = PEOPLE.lower[d]
    d = PEOPLE.dof_names.index(f"{finger}_base_rot_z")
    inputs[d] = getattr(PEOPLE, spread)[d]
    found = angles(inputs)
    assert found[f"{finger}_mcp_flexion"] == pytest.approx(90, abs=1)
    assert found[f"{finger}_pip_flexion"] == pytest.approx(110, abs=1e-4)
    assert found[f"{finger}_dip_flexion"] == pytest.approx(80, abs=1e-4)


@pytest.mark.parametrize("finger", LONG_FINGERS)
def test_noise_near_a_right_angle(finger: str, rng: np.random.Generator) -> None:
    """Where the knuckle's bend does not determine the spread, noise of 0.1 mm changes the
    other bends little.
    """
    for bend in np.radians([-88, -90, -92]):
        inputs = np.zeros(len(PEOPLE.initial))
        knuckle, pip = (
            PEOPLE.dof_names.index(f"{finger}_{joint}_rot_x") for joint in ("base", "pip")
        )
        inputs[knuckle], inputs[pip] = bend - PEOPLE.initial[knuckle], -1.0
        exact = -np.degrees(PEOPLE.theta(inputs[None])[0, pip])
        for _ in range(20):
            joints = right_hand(inputs) + rng.uniform(-0.1, 0.1, (len(PEOPLE.joint_names), 3))
            found = anatomical_angles(PEOPLE, "right", joints)
            assert found[f"{finger}_pip_flexion"] == pytest.approx(exact, abs=30)


@pytest.mark.parametrize("seed", range(5))
def test_angles_do_not_depend_on_place_rotation_size_and_side(seed: int) -> None:
    inputs = any_pose(np.random.default_rng(seed))
    elsewhere = np.where(np.arange(len(inputs)) < 6, 0.3, inputs)
    found = np.array(list(angles(inputs).values()))
    smaller = anatomical_angles(PEOPLE, "right", right_hand(elsewhere, 90.0))
    left = anatomical_angles(PEOPLE, "left", right_hand(inputs) * MIRROR)
    assert list(smaller) == list(left) == list(ANGLES)
    assert np.allclose(found, list(smaller.values()), atol=1e-6)
    assert np.allclose(found, list(left.values()), atol=1e-6)


@pytest.mark.parametrize("finger", LONG_FINGERS)
def test_signs(finger: str) -> None:
    """Bending a knuckle raises its flexion; a turn to the thumb lowers the abduction of ring and
    little finger only.
    """
    rest = angles(with_dof("palm_x", 0.0))
    low = PEOPLE.lower[PEOPLE.dof_names.index(f"{finger}_base_rot_x")]
    bent = angles(with_dof(f"{finger}_base_rot_x", low))
    angle = f"{finger}_mcp_flexion"
    assert bent[angle] > rest[angle] + np.degrees(-low) / 2
    # positive turns lead away from the thumb at x
    towards_thumb = angles(with_dof(f"{finger}_base_rot_z", -0.2))
    change = towards_thumb[f"{finger}_mcp_abduction"] - rest[f"{finger}_mcp_abduction"]
    assert change < -5 if finger in ("ring", "little") else change > 5


def test_the_thumb_spreads() -> None:
    """Radial abduction changes with the rotation about z, palmar abduction with the
    rotation about y.
    """
    rest = angles(with_dof("palm_x", 0.0))
    across = angles(with_dof("thumb_pip_rot_z", 0.5))
    before = angles(with_dof("thumb_pip_rot_y", -0.4))
    assert across["thumb_cmc_radial_abduction"] < rest["thumb_cmc_radial_abduction"] - 10
    assert before["thumb_cmc_palmar_abduction"] > rest["thumb_cmc_palmar_abduction"] + 10


def test_the_smallest_turn() -> None:
    """The rotation from x to y keeps z and maps y to -x; half a turn is handled as well."""
    x, y, z = np.eye(3)
    assert np.allclose([turned(x, x, y), turned(y, x, y), turned(z, x, y)], [y, -x, z])
    assert np.allclose(turned(z, x, -x), -z)
