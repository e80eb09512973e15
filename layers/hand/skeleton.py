"""Skeleton: an articulated body, read from a prototxt file (skeleton_file.py).

``prototxt/hand/nyu.prototxt`` is the hand of the paper; another body is another file. The value of
a degree of freedom (DoF) is

    theta[d] = input[d] + initial[d]        (a fixed DoF: theta[d] = initial[d])

Each joint starts from its parent's position and frame, and applies in order
    translations along local axes by theta,  for each ``translate``
    rotations about local axes by theta,     for each ``rotate``; about z, x turns towards y
    a translation along a local axis,        for its ``bone``
The equations and the gradient are in kinematics.py.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from layers.hand.skeleton_file import (
    LENGTHS,
    MAX_VALUE,
    Axis,
    DofParameter,
    SkeletonParameter,
    format_length,
    max_length,
)
from netlib.blob import Array
from netlib.errors import NetlibError, PrototxtError, did_you_mean
from netlib.files.paths import ROOT, find, real
from netlib.proto import prototxt, schema

NYU_HAND = ROOT / "prototxt" / "hand" / "nyu.prototxt"


@dataclass(frozen=True)
class Motion:
    """The effect of one DoF on one joint."""

    kind: Literal["translate", "rotate"]
    axis: int  # local axis: 0, 1, 2 for x, y, z
    sign: float  # -1 for the negative axis
    dof: int
    row: int  # index among the free motions, the rows of a Jacobian; -1 if the DoF is fixed


class Skeleton:
    """The data of an articulated body with K joints, D DoFs, and Q free motions.

    dof_names, joint_names   names in the order of the file
    initial, lower, upper    (D,) float64: offset of the input, limits of the input
    fixed                    (D,) bool: DoFs that ignore their input
    parents                  (K,) index of the parent joint, -1 for a root
    order                    (K,) the joints, parents first
    motions                  per joint, its motions in the order of application
    bones                    (K,) signed bone lengths along each joint's bone axis
    bone_axes                (K,) axis of the bone: 0, 1, 2 for x, y, z; -1 without a bone
    driven                   (Q,) the DoF of each free motion; a DoF may drive several
    turns                    (Q,) bool: the free motion is a rotation, not a translation
    slides                   (D,) bool: the DoF drives a translation
    """

    def __init__(self, param: SkeletonParameter) -> None:
        self.param, self.name = param, param.name
        if not param.joint:
            raise PrototxtError(
                schema.position_of(param), "this file has no joints; expected a skeleton"
            )
        self.dof_names = _unique([(d.name, d) for d in param.dof], "DoF")
        self.joint_names = _unique([(j.name, j) for j in param.joint], "joint")
        self.initial = np.array([d.initial for d in param.dof])
        self.lower = np.array([d.lower for d in param.dof])
        self.upper = np.array([d.upper for d in param.dof])
        self.fixed = np.array([d.fixed for d in param.dof], dtype=bool)
        self._check_numbers()
        joints = {name: i for i, name in enumerate(self.joint_names)}
        self.parents = np.array(
            [_index(j.parent, joints, j, "parent") for j in param.joint], dtype=int
        )
        self.bones = np.array(
            [_signed(j.bone.axis)[1] * j.bone.length if j.bone else 0.0 for j in param.joint]
        )
        self.bone_axes = np.array([_signed(j.bone.axis)[0] if j.bone else -1 for j in param.joint])
        depth = self._depths()
        self.order = sorted(range(len(depth)), key=lambda j: depth[j])
        self.motions = self._motions()
        free = [(j, m) for j, own in enumerate(self.motions) for m in own if m.row >= 0]
        self.driven = np.array([m.dof for _, m in free], dtype=int)
        self.turns = np.array([m.kind == "rotate" for _, m in free], dtype=bool)
        self.slides = np.zeros(len(param.dof), dtype=bool)
        self.slides[[m.dof for own in self.motions for m in own if m.kind == "translate"]] = True
        self._moved = [j for j, _ in free]  # (Q,) the joint of each free motion

    @functools.cached_property
    def descendants(self) -> Array:
        """(K, K) bool: whether the second joint is the first or one of its descendants."""
        descendants = np.eye(len(self.parents), dtype=bool)
        for j in self.order:
            if self.parents[j] >= 0:
                descendants[:, j] |= descendants[:, self.parents[j]]
        return descendants

    @functools.cached_property
    def moves(self) -> Array:
        """(Q, K) bool: whether the free motion moves the joint."""
        return np.asarray(
            self.descendants[self._moved].reshape(len(self._moved), len(self.parents))
        )

    def theta(self, inputs: Array) -> Array:
        """Values of the DoFs, (N, D) float64, for inputs (N, D)."""
        return np.asarray(np.where(self.fixed, 0.0, inputs) + self.initial, dtype=np.float64)

    def with_numbers(self, dofs: Sequence[DofParameter], bones: Array) -> Skeleton:
        """Return the body with other DoFs and signed bone lengths (K,)."""
        joints = list(self.param.joint)
        for i, joint in enumerate(joints):
            if joint.bone:
                length = _signed(joint.bone.axis)[1] * float(bones[i])
                joints[i] = replace(joint, bone=replace(joint.bone, length=length))
        return Skeleton(replace(self.param, dof=tuple(dofs), joint=tuple(joints)))

    def scaled(self, scale: float) -> Skeleton:
        """Return the body scaled by a factor: bones, initial translations and surface."""
        dofs = [
            replace(d, initial=d.initial * scale) if slides else d
            for d, slides in zip(self.param.dof, self.slides)
        ]
        longer = self.with_numbers(dofs, self.bones * scale).param
        return Skeleton(replace(longer, flesh=longer.flesh and longer.flesh.scaled(scale)))

    def with_free_slides(self) -> Skeleton:
        """Return the body with every DoF of a translation free."""
        dofs = [
            replace(d, fixed=d.fixed and not slides)
            for d, slides in zip(self.param.dof, self.slides)
        ]
        return Skeleton(replace(self.param, dof=tuple(dofs)))

    def with_surface(self) -> Skeleton:
        """Return the body with the additional joints and DoFs of its surface appended."""
        flesh = self.param.flesh
        if flesh is None:
            raise NetlibError(
                f"skeleton {self.name!r} has no flesh {{ ... }}; expected capsules around its bones"
            )
        return Skeleton(
            replace(
                self.param, dof=self.param.dof + flesh.dof, joint=self.param.joint + flesh.joint
            )
        )

    def _check_numbers(self) -> None:
        for joint in self.param.joint:
            if joint.bone and not abs(joint.bone.length) <= max_length(joint.bone):
                found = f"a bone of length {format_length(joint.bone.length)}; expected {LENGTHS}"
                raise PrototxtError(schema.position_of(joint.bone), found)
        for d in self.param.dof:
            if not abs(d.initial) <= MAX_VALUE:
                raise PrototxtError(
                    schema.position_of(d), f"{d.initial} is not a length or an angle"
                )
            if d.lower > d.upper:
                raise PrototxtError(
                    schema.position_of(d),
                    f"DoF {d.name!r}: lower limit {d.lower:g} is above {d.upper:g}",
                )
            lowest = -MAX_VALUE if d.lower == -np.inf else d.lower
            highest = MAX_VALUE if d.upper == np.inf else d.upper
            if not (abs(lowest) <= MAX_VALUE and abs(highest) <= MAX_VALUE):
                where = schema.position_of(d, "upper" if abs(lowest) <= MAX_VALUE else "lower")
                raise PrototxtError(
                    where, f"DoF {d.name!r}: limits {d.lower:g} and {d.upper:g}; expected numbers"
                )
            if not d.deviation > 0:
                raise PrototxtError(
                    schema.position_of(d, "deviation"), f"deviation {d.deviation:g}; expected > 0"
                )

    def _depths(self) -> dict[int, int]:
        """Number of joints from each joint up to its root.

        Raises PrototxtError if there is no root.
        """
        depth = {-1: 0}
        for joint in range(len(self.parents)):
            way: dict[int, None] = {}  # ancestors of the joint whose depths are not known yet
            at = joint
            while at not in depth:
                if at in way:
                    stuck = self.param.joint[at]
                    raise PrototxtError(
                        schema.position_of(stuck), f"joint {stuck.name!r} is its own ancestor"
                    )
                way[at] = None
                at = int(self.parents[at])
            for at in reversed(way):
                depth[at] = depth[int(self.parents[at])] + 1
        del depth[-1]
        return depth

    def _motions(self) -> list[tuple[Motion, ...]]:
        rows, result = 0, []
        dofs = {name: i for i, name in enumerate(self.dof_names)}
        for joint in self.param.joint:
            own = []
            for kind, params in (("translate", joint.translate), ("rotate", joint.rotate)):
                for param in params:
                    axis, sign = _signed(param.axis)
                    dof = _index(param.dof, dofs, param, "dof")
                    row = -1 if self.fixed[dof] else rows
                    rows += row >= 0
                    own.append(
                        Motion(
                            "translate" if kind == "translate" else "rotate", axis, sign, dof, row
                        )
                    )
            result.append(tuple(own))
        return result


def _index(name: str | None, known: Mapping[str, int], owner: object, field: str) -> int:
    """Index of a name; -1 for None."""
    if name is None:
        return -1
    if name not in known:
        where = schema.position_of(owner, field)
        raise PrototxtError(where, f"unknown {field} {name!r}{did_you_mean(name, known)}")
    return known[name]


def _unique(named: list[tuple[str, object]], what: str) -> list[str]:
    seen: set[str] = set()
    for name, param in named:
        if name in seen:
            raise PrototxtError(schema.position_of(param), f"{what} {name!r} is defined twice")
        seen.add(name)
    return [name for name, _ in named]


def _signed(axis: Axis) -> tuple[int, float]:
    return "XYZ".index(axis[-1]), -1.0 if axis.startswith("NEG_") else 1.0


def load(path: str | Path = NYU_HAND) -> Skeleton:
    """Load a skeleton file; default is the NYU hand. Raises PrototxtError, NetlibError."""
    return _load(Path(path), real(path))


@functools.lru_cache(maxsize=16)
def _load(path: Path, whole_path: Path) -> Skeleton:
    """Cached ``load``; the real path distinguishes files with the same relative name."""
    return Skeleton(schema.read(prototxt.parse_file(path), SkeletonParameter, f"skeleton {path}"))


def load_for(name: str, source: str | None) -> Skeleton:
    """Load the skeleton named in the prototxt ``source``; default is the NYU hand."""
    return load(find(name, source) if name else NYU_HAND)
