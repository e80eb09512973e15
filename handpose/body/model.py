"""The surface of a skeleton file: tables of its capsules and wedges, their positions in a pose, and
their penetration; and the fingers of a hand.

A capsule extends from one joint to another, with a radius at both. If it ends next to the joint,
the ``offset`` o of the joint gives the distance, along axes that rotate with a joint f of the body:

    E_j = X_j + size R_f o_j        with the pose's joints X_j and rotations R_f = world_from_f

A wedge is its three edges, which are capsules, and a facet between them (``handpose.body.render``).

All lengths are in the unit of the skeleton's bones. Joints are those of ``whole``, which is the
skeleton, followed by the joints of the surface alone (for a hand: the arm).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.body.capsules import Capsules
from handpose.body.joint_formats.frames import LONG_FINGERS
from layers.hand.bodies import kinematics_of
from layers.hand.kinematics import Kinematics, Pose
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import (
    LENGTHS,
    CapsuleParameter,
    FleshParameter,
    OffsetParameter,
    WedgeParameter,
    format_length,
    max_length,
)
from netlib.blob import Array
from netlib.errors import PrototxtError, did_you_mean
from netlib.proto import schema

FINGERS = ("thumb", *LONG_FINGERS)
_TINY = 1e-9  # instead of 0 as a divisor
Sphere = tuple[int, float]  # its joint and its radius


class Surface:
    """The M capsules of a skeleton, including the edges of its wedges; the same skeleton gives
    the same tables.

    whole      the skeleton with the additional joints and DoFs of the surface
    start, end (M,) joints that the capsules connect
    radii      (M, 2) at both
    limbs      (M,) True if it ends at a joint of the surface alone
    facets     (T, 3) the spheres of each wedge, 2 m for the start of capsule m, 2 m + 1 for its end
    trunk      (M,) True if it moves with the root alone
    offsets    for each joint f with offsets: the joints j, and their o_j (n, 3) in its axes
    apart      two arrays (P,): pairs of capsules that must not penetrate each other
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        self.whole = skeleton.with_surface()
        surface = skeleton.param.flesh
        assert surface is not None  # checked by with_surface
        if not surface.capsule and not surface.wedge:
            raise PrototxtError(schema.position_of(surface), "no capsule and no wedge in the flesh")
        capsules, facets = self._capsules_of(surface)
        self.start, self.end = np.array([[joint for joint, _ in ends] for ends in capsules]).T
        self.radii = np.array([[radius for _, radius in ends] for ends in capsules])
        self.facets = np.array(facets, dtype=int).reshape(-1, 3)
        self.limbs = self.end >= len(skeleton.joint_names)
        self.trunk = self._moves_with_root_alone()
        self.offsets = self._offsets_of(surface.offset)
        self.deviation = np.array([d.deviation for d in self.whole.param.dof])
        self.apart = self._keep_apart()

    def _capsules_of(
        self, surface: FleshParameter
    ) -> tuple[list[tuple[Sphere, Sphere]], list[list[int]]]:
        """The capsules, the edges of wedges first, and the facets; sets ``parts``."""
        capsules: list[tuple[Sphere, Sphere]] = []
        self.parts: list[str] = []
        facets = []
        for w in surface.wedge:
            corners = self._wedge(w)
            for edge in itertools.combinations(corners, 2):
                if edge not in capsules and edge[::-1] not in capsules:
                    capsules.append(edge)
                    self.parts.append(w.part)
            spheres = list(itertools.chain(*capsules))
            facets.append([spheres.index(corner) for corner in corners])
        capsules += [self._capsule(c) for c in surface.capsule]
        self.parts += [c.part for c in surface.capsule]
        return capsules, facets

    def _moves_with_root_alone(self) -> NDArray[np.bool_]:
        """Whether (M,) no motion but the root's moves a capsule."""
        whole = self.whole
        roots = np.flatnonzero(whole.parents < 0)
        rows = [m.row for root in roots for m in whole.motions[root] if m.row >= 0]
        bent = np.asarray(np.delete(whole.moves, rows, axis=0).any(axis=0))
        return ~bent[self.start] & ~bent[self.end]

    def _offsets_of(
        self, offsets: Sequence[OffsetParameter]
    ) -> dict[int, tuple[NDArray[np.int_], Array]]:
        """The offsets by the joint f in whose axes they are. Raises PrototxtError."""
        for i, o in enumerate(offsets):
            if (o.joint, o.axes) in [(other.joint, other.axes) for other in offsets[:i]]:
                raise PrototxtError(
                    schema.position_of(o), f"joint {o.joint!r} has two offsets along {o.axes!r}"
                )
            if not all(abs(length) <= max_length(o) for length in (o.x, o.y, o.z)):
                lengths = ", ".join(map(format_length, (o.x, o.y, o.z)))
                found = f"offset {lengths}; expected lengths in {LENGTHS}"
                raise PrototxtError(schema.position_of(o), found)
        axes = np.array([self._joint(o, "axes", o.axes) for o in offsets], dtype=int)
        joints = np.array([self._joint(o, "joint", o.joint) for o in offsets], dtype=int)
        vectors = np.array([(o.x, o.y, o.z) for o in offsets]).reshape(-1, 3)
        return {int(f): (joints[axes == f], vectors[axes == f]) for f in np.unique(axes)}

    @property
    def kinematics(self) -> Kinematics:
        """The kinematics of the whole body, for the engine in use."""
        return kinematics_of(self.whole)

    def ends(self, pose: Pose, size: Array | float = 1.0, offset: Array | float = 1.0) -> Array:
        """The ends of the capsules of each joint, (N, K, 3), in poses of the whole body.

        size, offset  (N,) factors of the offsets
        """
        return self.ends_at(
            pose.joints,
            {f: self.kinematics.rotation_of(pose, f) for f in self.offsets},
            size,
            offset,
        )

    def ends_at(
        self,
        joints: Array,
        rotations: dict[int, Array],
        size: Array | float = 1.0,
        offset: Array | float = 1.0,
    ) -> Array:
        """``ends`` for given joints (N, K, 3) and rotations (N, 3, 3) of the joints that the
        offsets refer to.
        """
        ends = joints.copy()
        factor = np.broadcast_to(np.multiply(size, offset), len(joints))[:, None, None]
        for f, (own, vectors) in self.offsets.items():
            ends[:, own] += factor * (vectors @ rotations[f].swapaxes(1, 2))
        return ends

    def penetration(self, ends: Array, radii: Array) -> Array:
        """The maximum penetration (N,) of parts that should be apart; ends (N, K, 3),
        radii (N, M, 2).
        """
        a, b = (ends[:, joints].transpose(2, 1, 0) for joints in (self.start, self.end))
        return self._depths(a, b, radii.transpose(1, 2, 0)).max(axis=0, initial=-np.inf)

    def mean_penetration(self, capsules: Capsules) -> Array:
        """The mean (N,), over all capsules, of how deep one that should be apart penetrates
        each, at least 0.
        """
        a, b = capsules.a.transpose(2, 1, 0), capsules.b.transpose(2, 1, 0)
        depths = self._depths(a, b, np.stack([capsules.radius_a.T, capsules.radius_b.T], axis=1))
        deepest = np.zeros(a.shape[1:])
        for own in self.apart:
            np.maximum.at(deepest, own, depths)
        return deepest.mean(axis=0)

    def _depths(self, a: Array, b: Array, r: Array) -> Array:
        """The penetrations (P, N) of the pairs ``apart``; ends (3, M, N), radii (M, 2, N)."""
        i, j = self.apart
        s, t, distance = _between(a[:, i], b[:, i], a[:, j], b[:, j])
        ra, rb = r[i, 0], r[i, 1]
        rc, rd = r[j, 0], r[j, 1]
        thick = ra + s * (rb - ra) + rc + t * (rd - rc)
        return thick - distance

    def _capsule(self, c: CapsuleParameter) -> tuple[Sphere, Sphere]:
        r = self._radii(c, c.radius, 2)
        return (self._joint(c, "from", c.from_), r[0]), (self._joint(c, "to", c.to), r[1])

    def _wedge(self, w: WedgeParameter) -> list[Sphere]:
        joints = [self._joint(w, "joint", name) for name in w.joint]
        if len(joints) != 3 or len(set(joints)) != 3:
            raise PrototxtError(
                schema.position_of(w), f"joints {', '.join(w.joint)}; expected three different ones"
            )
        return list(zip(joints, self._radii(w, w.radius, 3)))

    @staticmethod
    def _radii(shape: object, given: tuple[float, ...], count: int) -> list[float]:
        are_lengths = all(0 < r <= max_length(shape) for r in given)
        if len(given) not in (1, count) or not are_lengths:
            found = f"radius {', '.join(map(format_length, given))}"
            expected = {2: "two", 3: "three"}[count]
            raise PrototxtError(
                schema.position_of(shape), f"{found}; expected one or {expected} > 0, in {LENGTHS}"
            )
        return [*given] * (count if len(given) == 1 else 1)

    def _joint(self, param: object, field: str, name: str) -> int:
        if name not in self.whole.joint_names:
            where = schema.position_of(param, field)
            raise PrototxtError(
                where, f"unknown joint {name!r}{did_you_mean(name, self.whole.joint_names)}"
            )
        return self.whole.joint_names.index(name)

    def _keep_apart(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Pairs of capsules of different parts that do not penetrate each other at rest,
        with all inputs 0.
        """
        named = [m for m, part in enumerate(self.parts) if part]
        pairs = [
            (i, j) for i, j in itertools.combinations(named, 2) if self.parts[i] != self.parts[j]
        ]
        i, j = np.array(pairs, dtype=int).reshape(-1, 2).T
        ends = self.ends(self.kinematics.forward(np.zeros((1, len(self.whole.initial)))))
        a, b = (ends[0, joints].T for joints in (self.start, self.end))
        _, _, distance = _between(a[:, i], b[:, i], a[:, j], b[:, j])
        clear = distance > self.radii[i].max(axis=1) + self.radii[j].max(axis=1)
        return i[clear], j[clear]


def _between(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array, Array]:
    """The nearest points of the segments ab and cd, arrays (3, ...): position on each, 0 to 1, and
    their distance.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv = (u * u).sum(0), (v * v).sum(0)
    uw, vw = (u * w).sum(0), (v * w).sum(0)
    uv = (u * v).sum(0)
    determinant = np.maximum(uu * vv - uv * uv, _TINY)
    s = np.clip((uv * vw - uw * vv) / determinant, 0, 1)
    t = np.clip((uv * s + vw) / np.maximum(vv, _TINY), 0, 1)
    s = np.clip((uv * t - uw) / np.maximum(uu, _TINY), 0, 1)
    apart = w + s * u - t * v
    return s, t, np.sqrt((apart**2).sum(0))


def has_fingers(skeleton: Skeleton) -> bool:
    """True for a hand: a skeleton with a PIP joint, a DIP joint and a tip of each of
    the five fingers.
    """
    return all(
        joint in skeleton.joint_names
        for finger in FINGERS
        for point in _joints(finger)
        for joint in point
    )


class Fingers:
    """The joints and the capsules of each finger of a hand with this surface.

    capsules  (5, M) True for those of each finger
    """

    def __init__(self, surface: Surface) -> None:
        names = surface.skeleton.joint_names
        self._weights = np.zeros((3 * len(FINGERS), len(names)))
        for row, point in enumerate(point for finger in FINGERS for point in _joints(finger)):
            for joint in point:
                self._weights[row, names.index(joint)] = 1 / len(point)
        self.capsules: NDArray[np.bool_] = np.array(
            [[part == finger for part in surface.parts] for finger in FINGERS]
        )

    def joints(self, joints: Array) -> Array:
        """The three joints (N, 5, 3, 3) of each finger, of the joints (N, K, 3) of hands."""
        return (self._weights @ joints).reshape(len(joints), len(FINGERS), 3, 3)


def _joints(finger: str) -> list[tuple[str, ...]]:
    """The skeleton's joints in the middle of which a finger's PIP joint (up to 3 mm), DIP
    joint and tip are.
    """
    pip = ("thumb_pip",) if finger == "thumb" else (f"{finger}_pip_a", f"{finger}_pip_b")
    return [pip, (f"{finger}_dip",), (f"{finger}_tip",)]
