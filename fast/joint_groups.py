"""The motions of a skeleton's joints, with all that is fixed multiplied out beforehand, and joints in groups.

Joints of the same depth and the same motions, like those of limbs, are computed as one array.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from layers.hand.kinematics import rotation
from layers.hand.skeleton import Skeleton
from netlib.blob import Array


class Part(NamedTuple):
    """One motion of one joint, or several fixed turns multiplied out."""

    kind: Literal["translate", "rotate", "constant"]
    axis: int = -1  # local axis of a motion
    sign: float = 1.0  # -1: about or along the negative axis
    number: int = -1  # of the motion among the M that are not constants
    dof: int = -1
    matrix: Array | None = None  # of a constant: fixed rotations, multiplied out


def parts_of(skeleton: Skeleton) -> list[list[Part]]:
    """Every joint's operations in order; fixed rotations are multiplied out."""
    row, result = 0, []
    for motions in skeleton.motions:
        own: list[Part] = []
        for m in motions:
            if m.kind == "rotate" and skeleton.fixed[m.dof]:
                matrix = rotation(m.axis, m.sign * skeleton.initial[m.dof])
                if own and own[-1].matrix is not None:
                    matrix = own.pop().matrix @ matrix
                own.append(Part("constant", matrix=matrix))
            else:
                own.append(Part(m.kind, m.axis, m.sign, row, m.dof))
                row += 1
        result.append(own)
    return result


class Operation(NamedTuple):
    """The same part of n joints."""

    kind: Literal["translate", "rotate", "constant"]
    axis: int
    rows: slice | list[int]  # of the motions
    sign: Array  # (n, 1, 1)
    matrices: Array  # (n, 3, 3) of the constants


@dataclass
class Group:
    """Joints of one depth whose parts have the same kinds and axes: they are computed as one array."""

    joints: list[int]
    parent: int  # the group of their parents, -1 for roots
    slots: slice | list[int]  # where the parents stand in that group
    operations: list[Operation]
    bone_axis: int
    bodies: list[slice | list[int]]  # of roots: the joints of each one's body, itself too


def groups_of(
    skeleton: Skeleton, steps: Sequence[Sequence[Part]], dtype: DTypeLike
) -> tuple[list[Group], dict[int, tuple[int, int]]]:
    """Joints that can be computed together, parents first; and the (group, slot) of every joint."""
    parents, depth = skeleton.parents, skeleton.descendants.sum(axis=0)
    alike: dict[object, list[int]] = {}
    places: dict[int, tuple[int, int]] = {}
    for j in skeleton.order:
        kinds = tuple((step.kind, step.axis) for step in steps[j])
        alike.setdefault((depth[j], kinds, max(skeleton.bone_axes[j], 0)), []).append(j)
    groups: list[Group] = []
    for same in alike.values():  # depth by depth
        by_parent: dict[int, list[int]] = {}
        for j in same:
            by_parent.setdefault(places[int(parents[j])][0] if parents[j] >= 0 else -1, []).append(j)
        for parent, joints in by_parent.items():
            slots = [places[int(parents[j])][1] if parent >= 0 else 0 for j in joints]
            together = [_together(same_step, dtype) for same_step in zip(*(steps[j] for j in joints))]
            places.update({j: (len(groups), slot) for slot, j in enumerate(joints)})
            bodies = [_as_slice(np.flatnonzero(skeleton.descendants[j]).tolist()) for j in joints if parent < 0]
            axis = int(max(skeleton.bone_axes[joints[0]], 0))
            groups.append(Group(joints, parent, _as_slice(slots), together, axis, bodies))
    return groups, places


def _together(steps: Sequence[Part], dtype: DTypeLike) -> Operation:
    matrices = [step.matrix for step in steps if step.matrix is not None]
    return Operation(
        kind=steps[0].kind,
        axis=steps[0].axis,
        rows=_as_slice([step.number for step in steps]),
        sign=np.array([step.sign for step in steps], dtype)[:, None, None],
        matrices=np.array(matrices, dtype).reshape(-1, 3, 3),
    )


def _as_slice(indices: list[int]) -> slice | list[int]:
    """Consecutive indices as a slice, so that indexing with them copies nothing."""
    if indices == list(range(indices[0], indices[0] + len(indices))):
        return slice(indices[0], indices[0] + len(indices))
    return indices
