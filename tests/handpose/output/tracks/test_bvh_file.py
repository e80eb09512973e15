"""handpose/output/tracks/bvh_file.py, checked by a reader of BVH that is independent of our kinematics"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handpose.output.tracks.bvh_file import BvhWriter, bvh_text, nearest_frames
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from layers.hand.skeleton import load
from tests.support.bvh_reader import Bvh
from tests.support.made_tracks import any_hand, any_skeleton, header_of, skeleton_of

HAND = header_of(load())
# Two bones in a plane, which rotate about z; the file has the child first.
ARM = """
    name: "arm"
    dof { name: "x" } dof { name: "y" initial: 0.5 }
    dof { name: "shoulder" initial: 0.25 } dof { name: "elbow" }
    joint { name: "hand" parent: "elbow" rotate { axis: Z dof: "elbow" } bone { axis: X length: 1 } }
    joint { name: "elbow" parent: "base" rotate { axis: Z dof: "shoulder" } bone { axis: X length: 2 } }
    joint { name: "base" translate { axis: X dof: "x" } translate { axis: Y dof: "y" } }
"""
CAMERA = np.array([1000.0, 1000.0, -1000.0])  # from m in BVH's axes, z towards the camera, to mm in camera axes, z away


def joints_read(bvh: Bvh, header: TrackHeader) -> dict[int, np.ndarray]:
    """Joints (N, 3) in mm by number, in camera axes: the ends of their bones.

    Joints whose children all are translated are omitted, because BVH has no joint there.
    """
    sk, places = header.skeleton, bvh.positions()
    found = {}
    for j, name in enumerate(sk.joint_names):
        children = np.flatnonzero(sk.parents == j)
        still = [c for c in children if all(m.kind == "rotate" for m in sk.motions[c])]
        plain = [sk.joint_names[c].replace(" ", "_") for c in still]
        firsts = [f"{name}_turn1" if f"{name}_turn1" in places else name for name in plain]
        if firsts:
            found[j] = places[firsts[0]] * CAMERA
        elif not len(children):
            found[j] = places[name.replace(" ", "_") + " end"] * CAMERA
    return found


def poses(header: TrackHeader, hand: str, seed: int, count: int = 4) -> list[TrackedHand]:
    """Poses of one hand with constant bones."""
    rng = np.random.default_rng(seed)
    bones = header.skeleton.bones * rng.uniform(0.8, 1.2, len(header.skeleton.bones))
    return [any_hand(header, rng, 0, hand, bones) for _ in range(count)]


def text_of(header: TrackHeader, made: list[TrackedHand], rate: float = 30.0) -> str:
    """The text of a file with these poses."""
    inputs, origins = (np.array([getattr(pose, name) for pose in made]) for name in ("inputs", "origin_mm"))
    return bvh_text(header, made[0].hand, inputs, origins, made[0].bones, rate)


def check(header: TrackHeader, hand: str, seed: int) -> int:
    """Assert that all readable joints are at their places, and return their number."""
    made = poses(header, hand, seed)
    found = joints_read(Bvh(text_of(header, made)), header)
    for j, places in found.items():
        assert np.abs(places - [pose.xyz[j] for pose in made]).max() < 1e-3
    return len(found)


@pytest.mark.parametrize("hand", ["right", "left"])
@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_the_hand_is_where_it_was(hand: str, seed: int) -> None:
    """All 31 joints are restored to a thousandth of a mm, for right and left hands."""
    assert check(HAND, hand, seed) == 31


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_any_body(seed: int) -> None:
    """Bodies with several roots, any rotations and translations, fixed DoFs and joints without bones are restored."""
    check(header_of(any_skeleton(seed), 100.0), "left" if seed % 2 else "right", seed)


@pytest.mark.parametrize("hand", ["right", "left"])
def test_a_planar_arm(hand: str) -> None:
    """A body with children before parents, and a root that does not rotate, is restored."""
    assert check(header_of(skeleton_of(ARM), 100.0), hand, 0) == 3


def test_true_angles_and_bones() -> None:
    """The elbow's channel is its angle and its OFFSET the upper arm; a left hand rotates the other way about z."""
    header = header_of(skeleton_of(ARM), 100.0)
    for hand, side in (("right", 1), ("left", -1)):
        pose = replace(any_hand(header, np.random.default_rng(0), 0, hand), inputs=np.array([0, 0, 0.5, 0.75]))
        bvh = Bvh(text_of(header, [replace(pose, bones=np.array([1.5, 2.5, 0.0]))]))
        base, elbow, hand_joint, end = bvh.bones()
        assert [bone.name for bone in bvh.bones()] == ["base", "elbow", "hand", "Site"]
        assert base.channels == ["Xposition", "Yposition", "Zposition", "Zrotation", "Xrotation", "Yrotation"]
        assert elbow.channels == ["Zrotation", "Xrotation", "Yrotation"]
        assert np.allclose(elbow.offset, 0)
        assert np.allclose(hand_joint.offset, [side * 0.25, 0, 0])
        assert np.allclose(end.offset, [side * 0.15, 0, 0])
        assert np.allclose(bvh.motion[0, 3:], [0, 0, 0, side * np.degrees(0.75), 0, 0, side * np.degrees(0.75), 0, 0])


def test_what_importers_expect() -> None:
    """Names are unique ASCII words without spaces, and lines have the form that Blender's importer parses."""
    names = ["Büro der Hand", "Buro der Hand", "", "手"]
    joints = "".join(f'joint {{ name: "{name}" {f"parent: {chr(34)}{names[0]}{chr(34)}" if i else ""} }}'
                     for i, name in enumerate(names))
    header = header_of(skeleton_of(joints))
    text = text_of(header, [any_hand(header, np.random.default_rng(0))], 25.0)
    assert re.findall(r"(?:ROOT|JOINT) (.*)", text) == ["Buro_der_Hand", "Buro_der_Hand_2", "joint", "joint_2"]
    assert text.isascii()
    assert "\nMOTION\nFrames: 1\nFrame Time: 0.040000000\n" in text
    assert text.count("End Site\n") == 3


def test_no_angle_jumps() -> None:
    """A continuous rotation stays continuous in the file, because programs interpolate between frames."""
    header = header_of(skeleton_of(ARM))
    hand = any_hand(header, np.random.default_rng(0))
    angles = (np.linspace(0, 12, 60) + np.pi) % (2 * np.pi) - np.pi
    made = [replace(hand, inputs=np.array([0, 0, angle, 0])) for angle in angles]
    motion = Bvh(text_of(header, made)).motion
    assert np.ptp(motion[:, 6]) == pytest.approx(np.degrees(12), abs=1e-5)


# ---------------------------------------------------------------------------------------------- over time


def written(path: Path, frames: list[TrackedFrame], rate: float | None = None) -> list[Path]:
    """The paths of the files of a track of the packaged hand."""
    with BvhWriter(path, HAND, rate) as writer:
        for frame in frames:
            writer.write(frame)
    return writer.files


def shown(path: Path, made: list[TrackedHand]) -> list[int]:
    """The index of the pose that each frame of the file shows, found by the tip of the index finger."""
    tips = joints_read(Bvh(path.read_text()), HAND)[HAND.skeleton.joint_names.index("index_tip")]
    wanted = np.array([pose.xyz[HAND.skeleton.joint_names.index("index_tip")] for pose in made])
    return np.abs(tips[:, None] - wanted).max(axis=2).argmin(axis=1).tolist()


def test_a_file_for_each_hand(tmp_path: Path) -> None:
    """All files span the same frames; a lost hand keeps its last pose, and a later one waits in its first pose."""
    right, left = poses(HAND, "right", 1), poses(HAND, "left", 2)
    left = [replace(pose, id=1) for pose in left]
    frames = [
        TrackedFrame(0, 0.0, (right[0],)),
        TrackedFrame(1, 0.1, (right[1], left[0])),
        TrackedFrame(2, 0.2, (left[1],)),
        TrackedFrame(3, 0.3, (right[3], left[2])),
    ]
    files = written(tmp_path / "wave.bvh", frames)
    assert files == [tmp_path / "wave_right_0.bvh", tmp_path / "wave_left_1.bvh"]
    assert sorted(tmp_path.iterdir()) == sorted(files)
    assert shown(files[0], right) == [0, 1, 1, 3]
    assert shown(files[1], left) == [0, 0, 1, 2]


def test_a_gap_in_the_recording(tmp_path: Path) -> None:
    """Frames of BVH are equally spaced, and each shows the frame nearest in time."""
    made = poses(HAND, "right", 1)
    frames = [TrackedFrame(n, time, (pose,)) for n, (time, pose) in enumerate(zip((1.0, 1.1, 1.21, 1.6), made))]
    (file,) = written(tmp_path / "a.bvh", frames, rate=10.0)
    assert shown(file, made) == [0, 1, 2, 2, 2, 3, 3]
    assert Bvh(file.read_text()).frame_time == pytest.approx(0.1)


def test_the_hand_that_it_was_in_the_end(tmp_path: Path) -> None:
    """A hand's final side and bones are used, and earlier frames with the other side are omitted."""
    first, later = poses(HAND, "left", 1, 2), poses(HAND, "right", 2, 2)
    frames = [TrackedFrame(n, n / 10, (pose,)) for n, pose in enumerate([*first, *later])]
    (file,) = written(tmp_path / "a.bvh", frames)
    assert file.name == "a_right_0.bvh"
    assert shown(file, later) == [0, 0, 0, 1]


def test_an_interruption_leaves_whole_files(tmp_path: Path) -> None:
    """After an interruption the files of the frames so far are complete."""
    (pose,) = poses(HAND, "right", 1, 1)
    with pytest.raises(KeyboardInterrupt), BvhWriter(tmp_path / "a.bvh", HAND) as writer:
        writer.write(TrackedFrame(0, 0.0, (pose,)))
        raise KeyboardInterrupt
    assert shown(tmp_path / "a_right_0.bvh", [pose]) == [0]


def test_no_hand_no_file(tmp_path: Path) -> None:
    """Without hands there is no file; a missing folder raises an error at the start."""
    assert written(tmp_path / "a.bvh", [TrackedFrame(0, 0.0, ())]) == []
    with pytest.raises(FileNotFoundError) as caught, BvhWriter(tmp_path / "none" / "a.bvh", HAND):
        pytest.fail("began all the same")
    assert caught.value.filename == str(tmp_path / "none" / "a.bvh")


def test_nearest_frames() -> None:
    """The rate is that of most frames, unless given; a single frame stays one."""
    numbers, rate = nearest_frames(np.array([0, 0.1, 0.2, 0.31, 0.4]))
    assert numbers.tolist() == [0, 1, 2, 3, 4]
    assert rate == pytest.approx(10)
    assert nearest_frames(np.array([5.0]))[0].tolist() == [0]


@pytest.mark.parametrize(
    ("steps", "rate"),
    [
        ([0.001, 0.0657] * 150 + [0.001], 30.0),
        ([0.0657, 0.001] * 150 + [0.0657], 30.0),
        (([0.001] * 5 + [0.195]) * 50, 30.0),
        ([1 / 30] * 100 + [20.0] + [1 / 30] * 100 + [20.0] + [1 / 30] * 20, 30.0),
        ([1 / 30, 1 / 30, 1 / 15, 1 / 30] * 50, 30.0),
    ],
    ids=["pairs", "pairs, the other half", "bursts of six", "pauses", "lost frames"],
)
def test_the_rate_of_uneven_times(steps: list[float], rate: float) -> None:
    """Bursts do not increase the rate; pauses and lost frames do not reduce it."""
    assert nearest_frames(np.cumsum([0.0, *steps]))[1] == pytest.approx(rate, rel=0.2)
