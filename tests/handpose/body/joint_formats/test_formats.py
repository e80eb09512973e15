"""handpose/body/joint_formats/formats.py, and the directions computed by frames.py"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from posed_hands import MIRROR, PEOPLE, any_pose, right_hand

from handpose.body.joint_formats.formats import FORMATS, FormatName, formatted
from handpose.body.joint_formats.frames import FINGERS, frames_of
from handpose.body.nyu import EVALUATION_JOINTS
from handpose.frames.cameras import KINECT2
from layers.hand.kinematics import Kinematics


def test_orders() -> None:
    """Joints are in the order that the other systems define."""
    assert [list(FORMATS["mediapipe"].joints)[i] for i in (0, 1, 4, 5, 8, 17, 20)] == [
        "WRIST", "THUMB_CMC", "THUMB_TIP", "INDEX_FINGER_MCP", "INDEX_FINGER_TIP", "PINKY_MCP", "PINKY_TIP",
    ]
    assert [list(FORMATS["mano"].joints)[i] for i in (0, 1, 4, 7, 10, 13, 15, 16, 20)] == [
        "wrist", "index1", "middle1", "pinky1", "ring1", "thumb1", "thumb3", "thumb_tip", "pinky_tip",
    ]
    assert {name: len(one.joints) for name, one in FORMATS.items()} == {"mediapipe": 21, "mano": 21, "nyu": 14}


@pytest.mark.parametrize("name", FORMATS)
def test_bones_are_pairs_of_joints(name: FormatName) -> None:
    """Every bone is a pair of joints, and the bones reach all joints."""
    joints, bones = set(FORMATS[name].joints), FORMATS[name].bones
    assert {joint for bone in bones for joint in bone} == joints
    assert len(bones) >= len(joints) - 1


def test_nyu_is_the_evaluation() -> None:
    """The format ``nyu`` has the 14 evaluation joints in the papers' order, unchanged."""
    joints = right_hand(any_pose(np.random.default_rng(0)))
    assert np.array_equal(formatted("nyu", PEOPLE, "right", joints).positions, joints[list(EVALUATION_JOINTS)])


def test_axes_and_units() -> None:
    """A hand at x 100, y 50, z 500 mm, in metres: y points down."""
    joints = np.broadcast_to([100.0, 50.0, 500.0], (31, 3)) + 1e-3 * right_hand(any_pose(np.random.default_rng(0)))
    for name in ("mediapipe", "mano"):
        found = formatted(name, PEOPLE, "right", joints).positions  # type: ignore[arg-type]
        assert np.abs(found - (0.1, -0.05, 0.5)).max() < 2e-3


def test_landmarks_in_the_image() -> None:
    """x and y are projections as fractions of the image; z is the depth behind the wrist, scaled like x."""
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
    assert np.allclose(found.world_landmarks.mean(axis=0), 0) and np.allclose(
        found.world_landmarks + found.center, found.positions
    )


def test_landmarks_without_an_image() -> None:
    """In a crop landmarks are fractions of the cube; without a cube or an image size there are none."""
    joints = right_hand(any_pose(np.random.default_rng(3))) - [0, 0, 500]
    found = formatted("mediapipe", PEOPLE, "right", joints, cube_mm=300.0).landmarks
    assert found is not None
    assert np.allclose(
        found[:, :2] * 300, formatted("mediapipe", PEOPLE, "right", joints).positions[:, :2] * 1000 + 150
    )
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


def test_frames_are_the_models() -> None:
    """In any pose a finger's back is the z axis of the model's frame, and the thumb's back is -y."""
    for seed in range(5):
        inputs = any_pose(np.random.default_rng(seed))
        frames = Kinematics(PEOPLE).forward(inputs[None]).frames[0]
        found = frames_of(PEOPLE, right_hand(inputs))
        for finger in FINGERS:
            assert np.allclose(found.back[finger], frames[PEOPLE.joint_names.index(f"{finger}_base")][:, 2])
        assert np.allclose(found.back["thumb"], -frames[PEOPLE.joint_names.index("thumb_pip")][:, 1])
        joints = right_hand(inputs)
        index, little = (joints[PEOPLE.joint_names.index(name)] for name in ("index_mcp", "little_mcp"))
        assert found.radial @ (index - little) > 50
