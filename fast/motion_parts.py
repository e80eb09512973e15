"""The motions of a skeleton's joints, with all that is fixed multiplied out beforehand."""

from __future__ import annotations

from typing import Literal, NamedTuple

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
