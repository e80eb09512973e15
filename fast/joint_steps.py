"""The steps of forward kinematics: the motions of each joint with its fixed rotations multiplied,
and the joints that have equal steps.
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


class JointStep(NamedTuple):
    """One motion of one joint, or the product of consecutive fixed rotations."""

    kind: Literal["translate", "rotate", "constant"]
    axis: int = -1  # local axis of a motion
    sign: float = 1.0  # -1: about or along the negative axis
    number: int = -1  # index of the motion among the M that are not constants
    dof: int = -1
    matrix: Array | None = None  # for a constant: the product of fixed rotations


def steps_of(skeleton: Skeleton) -> list[list[JointStep]]:
    """The steps of each joint in order; consecutive fixed rotations are one step."""
    row = 0  # index of the next motion that is not constant
    result = []
    for motions in skeleton.motions:
        own: list[JointStep] = []
        for m in motions:
            if m.kind == "rotate" and skeleton.fixed[m.dof]:
                matrix = rotation(m.axis, m.sign * skeleton.initial[m.dof])
                if own and own[-1].matrix is not None:
                    matrix = own.pop().matrix @ matrix
                own.append(JointStep("constant", matrix=matrix))
            else:
                own.append(JointStep(m.kind, m.axis, m.sign, row, m.dof))
                row += 1
        result.append(own)
    return result


class Operation(NamedTuple):
    """The steps of n joints that are computed together."""

    kind: Literal["translate", "rotate", "constant"]
    axis: int
    rows: slice | list[int]  # indices of the motions
    sign: Array  # (n, 1, 1)
    matrices: Array  # (n, 3, 3) matrices of the constants


@dataclass
class Group:
    """Joints of one depth whose steps have the same kinds and axes, so that they are
    computed as one array.
    """

    joints: list[int]
    parent: int  # index of the parents' group; -1 for roots
    slots: slice | list[int]  # indices of the parents in that group
    operations: list[Operation]
    bone_axis: int
    bodies: list[slice | list[int]]  # for roots: indices of each root and its descendants


def groups_of(
    skeleton: Skeleton, steps: Sequence[Sequence[JointStep]], dtype: DTypeLike
) -> tuple[list[Group], dict[int, tuple[int, int]]]:
    """Group the joints, parents first.

    Returns the groups, and for each joint its group and its index in it.
    """
    places = {-1: (-1, 0)}  # -1: the parent of a root
    joints_by_key: dict[tuple[int, object, int], list[int]] = {}
    for j in skeleton.order:
        parent_group, _ = places[int(skeleton.parents[j])]
        kinds = tuple((step.kind, step.axis) for step in steps[j])
        key = parent_group, kinds, int(max(skeleton.bone_axes[j], 0))
        joints = joints_by_key.setdefault(key, [])
        places[j] = list(joints_by_key).index(key), len(joints)
        joints.append(j)
    groups = []
    for (parent_group, _, axis), joints in joints_by_key.items():
        slots = [places[int(skeleton.parents[j])][1] for j in joints]
        operations = [_operation(same, dtype) for same in zip(*(steps[j] for j in joints))]
        roots = joints if parent_group < 0 else []
        bodies = [_as_slice(np.flatnonzero(skeleton.descendants[j]).tolist()) for j in roots]
        groups.append(Group(joints, parent_group, _as_slice(slots), operations, axis, bodies))
    return groups, places


def _operation(steps: Sequence[JointStep], dtype: DTypeLike) -> Operation:
    """The operation for steps of equal kind and axis, one of each joint of a group."""
    rows = _as_slice([step.number for step in steps])
    signs = np.array([step.sign for step in steps], dtype)
    matrices = np.array([step.matrix for step in steps if step.matrix is not None], dtype)
    kind, axis = steps[0].kind, steps[0].axis
    return Operation(kind, axis, rows, signs[:, None, None], matrices.reshape(-1, 3, 3))


def _as_slice(indices: list[int]) -> slice | list[int]:
    """Convert consecutive indices to a slice, so that indexing with them returns a view."""
    if indices == list(range(indices[0], indices[0] + len(indices))):
        return slice(indices[0], indices[0] + len(indices))
    return indices
