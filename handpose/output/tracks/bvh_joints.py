"""A skeleton in the conventions of BVH, where a joint is at the start of its bone.

A joint of the skeleton rotates at its parent's position, then moves along its bone. A BVH joint is at its OFFSET from
its parent, and then rotates. So a BVH joint has the name and the rotations of the skeleton's, and the bone of the
parent joint as OFFSET; an End Site has the bone of a joint without children.

A BVH joint rotates about each axis once. A joint of the skeleton that rotates about an axis twice becomes several at
the same position, NAME_turn1 ... and finally NAME.

BVH is right-handed. With ``signs`` G (3,), a point p of the skeleton is at G p in BVH, and a rotation by t about the
axis a is one by det(G) G[a] t: the mirror image of the left-handed camera axes, mirrored again for a left hand.
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from typing import NamedTuple

import numpy as np

from layers.hand.skeleton import Motion, Skeleton
from netlib.blob import Array

ORDERS = list(itertools.permutations((2, 0, 1)))  # orders of turns; Z X Y first, as in all joints of the packaged hand
AXES = "XYZ"


class BvhJoint(NamedTuple):
    """A joint of the file.

    name    in the file
    depth   number of joints above it
    joint   index in the skeleton; -1 for a root that the skeleton does not have
    parent  index of the joint whose bone leads here; -1 without
    slides  translations from there to it
    order   the three axes of its rotations, in order
    turns   those that rotate
    moves   True if its position changes; its OFFSET is then 0, so that all readers agree about the position
    ends    True without children; an End Site follows
    """

    name: str
    depth: int
    joint: int
    parent: int
    slides: tuple[Motion, ...] = ()
    order: tuple[int, ...] = ORDERS[0]
    turns: tuple[Motion, ...] = ()
    moves: bool = False
    ends: bool = False


def bvh_joints(skeleton: Skeleton) -> list[BvhJoint]:
    """The joints of the file, in its order; the first one is the root."""
    children: list[list[int]] = [[] for _ in skeleton.parents]
    roots = [joint for joint, parent in enumerate(skeleton.parents.tolist()) if parent < 0]
    for joint in skeleton.order:
        if skeleton.parents[joint] >= 0:
            children[skeleton.parents[joint]].append(joint)
    found = [BvhJoint("root", 0, -1, -1)] if len(roots) > 1 else []
    to_do = [(root, len(found)) for root in reversed(roots)]
    while to_do:
        joint, depth = to_do.pop()
        found += _parts(skeleton, joint, depth, not children[joint])
        to_do += [(child, found[-1].depth + 1) for child in reversed(children[joint])]
    found[0] = found[0]._replace(moves=True)
    return [joint._replace(name=name) for joint, name in zip(found, _names([joint.name for joint in found]))]


def _parts(skeleton: Skeleton, joint: int, depth: int, ends: bool) -> list[BvhJoint]:
    """The joints of the file for one of the skeleton: each turns about different axes."""
    name, motions = skeleton.joint_names[joint], skeleton.motions[joint]
    runs = _runs([motion for motion in motions if motion.kind == "rotate"])
    names = [*(f"{name}_turn{i}" for i in range(1, len(runs))), name]
    parts = [BvhJoint(name, depth + i, joint, -1, (), _order(turns), tuple(turns))
             for i, (name, turns) in enumerate(zip(names, runs))]
    slides = tuple(motion for motion in motions if motion.kind == "translate")
    moves = any(motion.row >= 0 for motion in slides)
    parts[0] = parts[0]._replace(parent=int(skeleton.parents[joint]), slides=slides, moves=moves)
    parts[-1] = parts[-1]._replace(ends=ends)
    return parts


def _runs(turns: list[Motion]) -> list[list[Motion]]:
    """Turns in order, cut wherever an order of three different axes ends."""
    runs: list[list[Motion]] = [[]]
    for turn in turns:
        if turn.axis in [motion.axis for motion in runs[-1]]:
            runs.append([])
        runs[-1].append(turn)
    return runs


def _order(turns: list[Motion]) -> tuple[int, ...]:
    """The first order of three axes in which these follow each other."""
    axes = tuple(turn.axis for turn in turns)
    return next(order for order in ORDERS if tuple(a for a in order if a in axes) == axes)


def _names(names: list[str]) -> list[str]:
    """Names of ASCII without spaces, each once."""
    found: dict[str, None] = {}
    for name in names:
        ascii_name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
        plain = re.sub(r"[^\w.+-]+", "_", ascii_name) or "joint"
        numbered = (f"{plain}_{i}" for i in itertools.count(2))
        while plain in found:
            plain = next(numbered)
        found[plain] = None
    return list(found)


# ---------------------------------------------------------------------------------------------- numbers


def offset_of(skeleton: Skeleton, joint: BvhJoint, bones: Array) -> Array:
    """The position of a joint in its parent, (3,) in the skeleton's axes; its free translations are 0."""
    if joint.moves:
        return np.zeros(3)
    still = np.array([m.sign * skeleton.initial[m.dof] for m in joint.slides])
    return bone_of(skeleton, joint.parent, bones) + still @ np.eye(3)[[m.axis for m in joint.slides]]


def bone_of(skeleton: Skeleton, joint: int, bones: Array) -> Array:
    """A joint's bone as a vector (3,) in its own axes; 0 without one."""
    axis = skeleton.bone_axes[joint] if joint >= 0 else -1
    return np.asarray(np.eye(3)[axis] * bones[joint] if axis >= 0 else np.zeros(3))


def channels_of(
    skeleton: Skeleton, joint: BvhJoint, theta: Array, bones: Array, signs: Array
) -> tuple[Array | None, Array]:
    """Position (N, 3) in BVH's axes, None of one that does not move, and angles (N, 3) in rad in the joint's order.

    theta  (N, D) values of the DoFs
    """
    angles = np.zeros((len(theta), 3))
    for motion in joint.turns:
        turn = np.prod(signs) * signs[motion.axis] * motion.sign
        angles[:, joint.order.index(motion.axis)] = turn * theta[:, motion.dof]
    if not joint.moves:
        return None, angles
    position = np.tile(bone_of(skeleton, joint.parent, bones), (len(theta), 1))
    for motion in joint.slides:
        position[:, motion.axis] += motion.sign * theta[:, motion.dof]
    return position * signs, angles
