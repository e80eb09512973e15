"""Random bodies and tracks, for tests of writing and reading them."""

from __future__ import annotations

import numpy as np

from handpose.frames.cameras import NYU
from handpose.tracking.track import HandPose, TrackedFrame, TrackedHand, TrackHeader, joints_of
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter
from netlib.proto import prototxt, schema

AXES = ("X", "Y", "Z", "NEG_X", "NEG_Y", "NEG_Z")


def skeleton_of(text: str) -> Skeleton:
    """Return the skeleton of a file with this text."""
    return Skeleton(
        schema.read(prototxt.parse(text, "body.prototxt"), SkeletonParameter, "a skeleton")
    )


def any_skeleton(seed: int, joints: int = 7) -> Skeleton:
    """Return a random skeleton: several roots, children before parents, up to five rotations and
    two translations of a joint about any axes, some fixed, joints with and without bones.
    """
    rng = np.random.default_rng(seed)
    names = [f"joint {i}" for i in range(joints)]
    dofs, made = [], []
    for i in range(joints):
        parent = f'parent: "{names[rng.integers(i)]}"' if i and rng.random() < 0.85 else ""
        motions = ""
        for kind, most in (("translate", 2), ("rotate", 5)):
            for _ in range(rng.integers(most + 1)):
                name = f"dof {len(dofs)}"
                fixed = "fixed: true" if rng.random() < 0.3 else "lower: -2 upper: 2"
                dofs.append(
                    f'dof {{ name: "{name}" initial: {rng.uniform(-0.5, 0.5):.6f} {fixed} }}'
                )
                motions += f'{kind} {{ axis: {rng.choice(AXES)} dof: "{name}" }} '
        bone = (
            f"bone {{ axis: {rng.choice(AXES)} length: {rng.uniform(0.1, 1):.6f} }}"
            if rng.random() < 0.8
            else ""
        )
        made.append(f'joint {{ name: "{names[i]}" {parent} {motions} {bone} }}')
    return skeleton_of("\n".join(['name: "any"', *dofs, *made[::-1]]))


def header_of(skeleton: Skeleton, unit_mm: float = 150.0) -> TrackHeader:
    """Return the header of a recording by NYU's camera."""
    return TrackHeader("wave.bag", NYU, skeleton, unit_mm)


def any_hand(
    header: TrackHeader,
    rng: np.random.Generator,
    id: int = 0,
    hand: str = "right",
    bones: np.ndarray | None = None,
) -> TrackedHand:
    """Return a random pose; bones a little longer or shorter than the skeleton's, unless given."""
    sk = header.skeleton
    inputs = rng.uniform(-1.5, 1.5, len(sk.initial)) * ~sk.fixed
    if bones is None:
        bones = sk.bones * rng.uniform(0.8, 1.2)
    origin = rng.uniform(-200, 200, 3) + (0, 0, 800)
    xyz = joints_of(sk, header.unit_mm, hand, inputs, bones, origin)
    uvd = NYU.project(origin)
    sure, error, fingers = float(rng.random()), float(rng.uniform(2, 30)), rng.uniform(2, 60, 5)
    pose = HandPose(sk, hand, inputs, bones, origin, xyz, uvd, 300.0)
    return TrackedHand(id, hand, sure, error, pose, finger_error_mm=fingers)


def any_track(header: TrackHeader, seed: int, frames: int = 5) -> list[TrackedFrame]:
    """Return a right and a left hand at 30 frames a second; each is lost in some frames after its
    first, and grows.
    """
    rng = np.random.default_rng(seed)
    made, known = [], {}
    for n in range(frames):
        every = []
        for id, hand in enumerate(("right", "left")):
            if n not in (0, 2) and rng.random() < 0.3:
                if id in known:
                    reason = "it left the picture, at the left"
                    every.append(TrackedHand(id, hand, reason=reason, since=known[id][1]))
                continue
            bones = None if n in (0, 2) or id not in known else known[id][0]
            every.append(any_hand(header, rng, id, hand, bones))
            known[id] = every[-1].pose.bones, n / 30
        made.append(TrackedFrame(n, n / 30, tuple(every)))
    return made
