"""The skeleton file: messages that describe an articulated body, and a writer for them.

``prototxt/hand/nyu.prototxt`` is the hand of the paper; another body is another file. Lengths are
in half-cubes, angles in radians. ``dof`` and ``joint`` are explained in skeleton.py.

``flesh`` is the surface around the bones: convex hulls of two spheres at joints (capsules) or of
three (wedges). It is not used where only joints are computed.

    dof, joint  additional DoFs and joints of the surface: not predicted, but visible to the
                camera (an arm)
    offset      displacement of spheres from their joint
    capsule     round cones with a sphere at either end, for limbs
    wedge       convex hulls of three spheres, for flat parts
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from netlib.proto import schema
from netlib.proto.prototxt import Position, Scalar
from netlib.proto.schema import Double

Axis = Literal["X", "Y", "Z", "NEG_X", "NEG_Y", "NEG_Z"]
MAX_VALUE = 1e9  # limit of lengths and angles: their squares fit in float32
MAX_LENGTH = 10.0  # limit of lengths of body parts in half-cubes; a body must fit in its cube
LENGTHS = f"half-cubes, at most {MAX_LENGTH:g} (half the edge of the cube around the body: of 300 mm, 1 is 150 mm)"
DECIMALS = 6  # digits after the decimal point in written files, as in the packaged hand


@dataclass(frozen=True)
class DofParameter:
    """The ``dof`` block of a skeleton file."""

    name: str
    initial: Double = 0.0  # added to the input
    lower: Double = -np.inf  # limits of the input
    upper: Double = np.inf
    fixed: bool = False  # keeps the initial value, ignores the input
    deviation: Double = np.inf  # standard deviation of the inputs about 0; inf: unknown


@dataclass(frozen=True)
class MotionParameter:
    """The ``rotate`` or ``translate`` block of a joint: a DoF about or along a local axis."""

    axis: Axis
    dof: str


@dataclass(frozen=True)
class BoneParameter:
    """The ``bone`` block of a joint."""

    axis: Axis
    length: Double


@dataclass(frozen=True)
class JointParameter:
    """The ``joint`` block of a skeleton file."""

    name: str
    parent: str | None = None  # none: starts at the origin
    translate: tuple[MotionParameter, ...] = ()
    rotate: tuple[MotionParameter, ...] = ()
    bone: BoneParameter | None = None


@dataclass(frozen=True)
class OffsetParameter:
    """An ``offset`` block: displacement of capsule ends from a joint, in the frame of
    another joint.
    """

    joint: str
    axes: str
    x: Double = 0.0
    y: Double = 0.0
    z: Double = 0.0


@dataclass(frozen=True)
class CapsuleParameter:
    """A ``capsule`` block: a round cone between two joints."""

    from_: str
    to: str
    radius: tuple[Double, ...]  # at ``from`` and at ``to``, or one for both
    part: str = ""  # capsules of different parts may not intersect; "": no restriction


@dataclass(frozen=True)
class WedgeParameter:
    """A ``wedge`` block: the convex hull of spheres at three joints."""

    joint: tuple[str, ...]
    radius: tuple[Double, ...]  # at each joint, or one for all
    part: str = ""  # as for capsules


@dataclass(frozen=True)
class FleshParameter:
    """The ``flesh`` block of a skeleton file."""

    dof: tuple[DofParameter, ...] = ()
    joint: tuple[JointParameter, ...] = ()
    offset: tuple[OffsetParameter, ...] = ()
    capsule: tuple[CapsuleParameter, ...] = ()
    wedge: tuple[WedgeParameter, ...] = ()

    def scaled(self, scale: float) -> FleshParameter:
        """Return the surface of the body scaled by a factor."""

        def longer(joint: JointParameter) -> JointParameter:
            return replace(
                joint, bone=joint.bone and replace(joint.bone, length=joint.bone.length * scale)
            )

        def farther(offset: OffsetParameter) -> OffsetParameter:
            x, y, z = offset.x * scale, offset.y * scale, offset.z * scale
            return replace(offset, x=x, y=y, z=z)

        def wider(radii: tuple[Double, ...]) -> tuple[Double, ...]:
            return tuple(radius * scale for radius in radii)

        joints = tuple(map(longer, self.joint))
        offsets = tuple(map(farther, self.offset))
        capsules = tuple(replace(c, radius=wider(c.radius)) for c in self.capsule)
        wedges = tuple(replace(w, radius=wider(w.radius)) for w in self.wedge)
        return replace(self, joint=joints, offset=offsets, capsule=capsules, wedge=wedges)


@dataclass(frozen=True)
class SkeletonParameter:
    """A skeleton file."""

    name: str = ""
    dof: tuple[DofParameter, ...] = ()
    joint: tuple[JointParameter, ...] = ()  # in output order
    flesh: FleshParameter | None = None


def max_length(part: object) -> float:
    """Limit of the lengths of a part of a body: half-cubes if read from a file; computed
    ones may be mm.
    """
    return MAX_VALUE if schema.tree_of(part) is None else MAX_LENGTH


def format_length(length: float) -> str:
    """Format a length with all its digits, as on the page of the hand."""
    return repr(float(length)).removesuffix(".0")


def text_of(param: SkeletonParameter, name: str, comment: str) -> str:
    """Text of a skeleton file with this name and a comment at the top; numbers have
    ``DECIMALS`` digits.
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += [f"name: {_quoted(name)}", ""]
    lines += _dof_lines(param.dof)
    lines += ["", f"# Joints in output order: {len(param.joint)} x (x, y, z)."]
    lines += _joint_lines(param.joint)
    if param.flesh is not None:
        lines += ["", "flesh {", *(f"  {line}" for line in _flesh_lines(param.flesh)), "}"]
    return "\n".join(lines) + "\n"


def _dof_lines(dofs: tuple[DofParameter, ...]) -> Iterator[str]:
    width = max((len(_quoted(d.name)) for d in dofs), default=0)
    for i, d in enumerate(dofs):
        fields = [
            f"name: {_quoted(d.name).ljust(width)}",
            f"initial: {_number(d.initial).rjust(9)}",
        ]
        if d.fixed:
            fields.append("fixed: true")
        else:
            fields.append(f"lower: {_number(d.lower)} upper: {_number(d.upper)}")
        if np.isfinite(d.deviation):
            fields.append(f"deviation: {_number(d.deviation)}")
        yield f"dof {{ {'  '.join(fields)} }}  # {i}"


def _joint_lines(joints: tuple[JointParameter, ...]) -> Iterator[str]:
    for i, j in enumerate(joints):
        parent = f" parent: {_quoted(j.parent)}" if j.parent is not None else ""
        yield f"joint {{  # {i}"
        yield f"  name: {_quoted(j.name)}{parent}"
        for kind, motions in (("translate", j.translate), ("rotate", j.rotate)):
            for motion in motions:
                yield f"  {kind} {{ axis: {motion.axis} dof: {_quoted(motion.dof)} }}"
        if j.bone:
            yield f"  bone {{ axis: {j.bone.axis} length: {_number(j.bone.length)} }}"
        yield "}"


def _flesh_lines(flesh: FleshParameter) -> Iterator[str]:
    yield from _dof_lines(flesh.dof)
    yield from _joint_lines(flesh.joint)
    for o in flesh.offset:
        place = f"x: {_number(o.x)} y: {_number(o.y)} z: {_number(o.z)}"
        yield f"offset {{ joint: {_quoted(o.joint)} axes: {_quoted(o.axes)} {place} }}"
    for c in flesh.capsule:
        radii = " ".join(f"radius: {_number(r)}" for r in c.radius)
        part = f" part: {_quoted(c.part)}" if c.part else ""
        yield f"capsule {{ from: {_quoted(c.from_)} to: {_quoted(c.to)} {radii}{part} }}"
    for w in flesh.wedge:
        joints = " ".join(f"joint: {_quoted(joint)}" for joint in w.joint)
        radii = " ".join(f"radius: {_number(r)}" for r in w.radius)
        part = f" part: {_quoted(w.part)}" if w.part else ""
        yield f"wedge {{ {joints} {radii}{part} }}"


def _quoted(text: str) -> str:
    return str(Scalar("string", text, Position("", 1, 1)))


def _number(number: float) -> str:
    return str(int(number)) if float(number).is_integer() else f"{number:.{DECIMALS}f}"
