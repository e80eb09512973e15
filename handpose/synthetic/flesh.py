"""Flesh: capsules about the bones of a hand and a forearm, and how deep two parts of a hand are in each other."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose.synthetic.render import Capsules
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

FINGERS = ("little", "ring", "middle", "index")  # as they lie side by side
KNUCKLES = tuple(f"{finger}_mcp" for finger in FINGERS)
# The joints of each digit from where it leaves the palm to its tip.
DIGITS = {
    "thumb": ("thumb_pip", "thumb_dip", "thumb_tip"),
    **{f: tuple(f"{f}_{part}" for part in ("base", "pip_a", "pip_b", "dip", "tip")) for f in FINGERS},
}


def _along(finger: str, r: tuple[float, ...]) -> tuple[tuple[str, str, float, float], ...]:
    """Capsules of a finger from the knuckle to the tip, with the radius at each of its six points."""
    names = [f"{finger}_{part}" for part in ("mcp", "base", "pip_a", "pip_b", "dip", "tip")]
    return tuple((names[i], names[i + 1], r[i], r[i + 1]) for i in range(5))


def _all_fingers(part: str, value: float) -> tuple[tuple[str, float], ...]:
    return tuple((f"{finger}_{part}", value) for finger in FINGERS)


@dataclass(frozen=True)
class HandShape:
    """Capsules: from and to which joint, and the radii in mm at both."""

    capsules: tuple[tuple[str, str, float, float], ...] = (
        *_along("little", (12.0, 10.5, 9.5, 9.5, 8.5, 7.5)),
        *_along("ring", (13.0, 11.0, 10.5, 10.0, 9.0, 8.0)),
        *_along("middle", (13.0, 11.0, 11.0, 10.5, 9.5, 8.0)),
        *_along("index", (13.0, 11.0, 11.0, 10.5, 9.5, 8.0)),
        ("thumb_mcp", "thumb_pip", 17.0, 14.0),
        ("thumb_pip", "thumb_dip", 14.0, 10.5),
        ("thumb_dip", "thumb_tip", 10.5, 8.5),
        # The palm is solid: spokes from the wrist to the knuckles, the knuckles joined, the ball of the thumb.
        ("wrist_left", "little_mcp", 18.0, 13.0),
        ("wrist_left", "ring_mcp", 18.0, 13.5),
        ("wrist_middle", "ring_mcp", 18.5, 13.5),
        ("wrist_middle", "middle_mcp", 18.5, 13.5),
        ("wrist_middle", "index_mcp", 18.5, 13.5),
        ("wrist_left", "wrist_middle", 18.0, 18.5),
        ("wrist_middle", "thumb_mcp", 18.5, 17.0),
        ("little_mcp", "ring_mcp", 13.0, 13.5),
        ("ring_mcp", "middle_mcp", 13.5, 13.5),
        ("middle_mcp", "index_mcp", 13.5, 13.5),
        ("thumb_mcp", "palm", 17.0, 15.0),
        ("thumb_mcp", "index_mcp", 17.0, 13.5),
        ("thumb_pip", "index_mcp", 12.0, 12.0),
    )
    thickness_std: float = 0.08  # all radii of a hand together

    # Flesh lies on the palm's side of its bones, most at the wrist: mm that capsules end on that side of their joints.
    # Chosen on two real crops, whose surface was 8 mm off without, 5 mm with it.
    towards_palm: tuple[tuple[str, float], ...] = (
        ("wrist_left", 9.0),
        ("wrist_middle", 9.0),
        ("thumb_mcp", 8.0),
        ("thumb_pip", 2.0),
        ("palm", 6.0),
        *_all_fingers("mcp", 6.0),
        *_all_fingers("base", 2.0),
    )

    forearm_towards_palm: float = 5.0  # mm, of its axis: between the bones of the wrist and their flesh
    forearm_radius: tuple[float, float] = (25.0, 38.0)  # mm at the wrist and at the elbow's end
    forearm_length: float = 260.0  # mm
    forearm_flexion_std: float = 25.0  # degrees, normal: bending towards and away from the palm
    forearm_deviation_std: float = 18.0  # degrees, normal: bending sideways
    forearm_towards_camera: float = 0.35  # largest part of its direction that may point at the camera


DEFAULT_SHAPE = HandShape()


class Flesh:
    """The flesh of hands that have this skeleton and this shape.

    thickness_clip  the thickness is cut at so many deviations
    """

    def __init__(self, skeleton: Skeleton, shape: HandShape, thickness_clip: float) -> None:
        self.shape, self.thickness_clip = shape, thickness_clip
        name = skeleton.joint_names.index
        self._from = np.array([name(c[0]) for c in shape.capsules])
        self._to = np.array([name(c[1]) for c in shape.capsules])
        self._radii = np.array([c[2:] for c in shape.capsules])
        self._towards_palm = np.zeros(len(skeleton.joint_names))
        self._towards_palm[[name(joint) for joint, _ in shape.towards_palm]] = [mm for _, mm in shape.towards_palm]
        self._pairs = pairs_that_keep_apart(shape)
        self._wrist = [name("wrist_left"), name("wrist_middle")]
        self._knuckles = [name(knuckle) for knuckle in KNUCKLES]

    def capsules(self, rng: np.random.Generator, joints: Array, scale: Array) -> Capsules:
        """Capsules around hands with ``joints`` (N, 31, 3) in mm and sizes ``scale`` (N,), and their forearms."""
        h, N = self.shape, len(joints)
        thickness = scale * (1 + h.thickness_std * cut_normal(rng, (N,), self.thickness_clip))
        down, across, back = self.palm_axes(joints)
        flexion = np.deg2rad(h.forearm_flexion_std) * rng.standard_normal((N, 1))
        deviation = np.deg2rad(h.forearm_deviation_std) * rng.standard_normal((N, 1))
        arm = np.cos(flexion) * (np.cos(deviation) * down + np.sin(deviation) * across) + np.sin(flexion) * back
        arm[:, 2] = np.maximum(arm[:, 2], -h.forearm_towards_camera)
        arm[:, :2] = _unit(arm[:, :2]) * np.sqrt(1 - arm[:, 2:] ** 2)
        radii = np.concatenate([self._radii, [h.forearm_radius]]) * thickness[:, None, None]
        wrist = joints[:, self._wrist].mean(axis=1) - h.forearm_towards_palm * scale[:, None] * back
        elbow = wrist + h.forearm_length * scale[:, None] * arm
        ends = self._capsule_ends(joints, scale, back)
        return Capsules(
            np.concatenate([ends[:, self._from], wrist[:, None]], axis=1),
            np.concatenate([ends[:, self._to], elbow[:, None]], axis=1),
            radii[:, :, 0],
            radii[:, :, 1],
        )

    def penetration(self, joints: Array, scale: Array) -> Array:
        """How deep in mm (N,) two parts of a hand that should not meet are in each other; joints (N, 31, 3) in mm."""
        _, _, back = self.palm_axes(joints)
        ends = self._capsule_ends(joints, scale, back)
        a, b = ends[:, self._from].transpose(2, 1, 0), ends[:, self._to].transpose(2, 1, 0)
        radii = self._radii[:, :, None] * scale
        i, j = self._pairs
        s, t, distance = _between(a[:, i], b[:, i], a[:, j], b[:, j])
        thick = radii[i, 0] + s * (radii[i, 1] - radii[i, 0]) + radii[j, 0] + t * (radii[j, 1] - radii[j, 0])
        return np.asarray((thick - distance).max(axis=0))

    def palm_axes(self, joints: Array) -> tuple[Array, Array, Array]:
        """Unit vectors (N, 3): down to the wrist, across it to the thumb, out of the hand's back."""
        down = _unit(joints[:, self._wrist].mean(axis=1) - joints[:, self._knuckles].mean(axis=1))
        across = joints[:, self._wrist[1]] - joints[:, self._wrist[0]]
        across = _unit(across - (across * down).sum(1, keepdims=True) * down)
        return down, across, np.cross(down, across)

    def _capsule_ends(self, joints: Array, scale: Array, back: Array) -> Array:
        """Where the capsules of each joint end, (N, 31, 3) in mm: some way from it towards the palm."""
        return np.asarray(joints - np.einsum("n,j,nk->njk", scale, self._towards_palm, back))


def pairs_that_keep_apart(shape: HandShape) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Capsules that should not be in each other, (P,) and (P,): of two digits, or of a digit's end and the palm.

    The first capsules of neighbouring fingers meet where the fingers leave the palm, so they may.
    """
    place = {ends: (digit, k) for digit, joints in DIGITS.items() for k, ends in enumerate(itertools.pairwise(joints))}
    segments = [(n, *place[a, b]) for n, (a, b, _, _) in enumerate(shape.capsules) if (a, b) in place]
    neighbours = {frozenset(fingers) for fingers in itertools.pairwise(FINGERS)}
    pairs = [
        (i, j)
        for (i, digit, k), (j, other, m) in itertools.combinations(segments, 2)
        if digit != other and not (k == m == 0 and frozenset((digit, other)) in neighbours)
    ]
    ends = [n for n, digit, k in segments if k >= (1 if digit == "thumb" else 2)]
    spokes = [n for n, (a, b, _, _) in enumerate(shape.capsules) if a.startswith("wrist_") and b in KNUCKLES]
    pairs += itertools.product(ends, spokes)
    i, j = np.array(pairs).T
    return i, j


def _between(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array, Array]:
    """Nearest points of the segments ab and cd, arrays (3, ...): where on each, 0 to 1, and their distance."""
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (u * u).sum(0), (v * v).sum(0), (u * v).sum(0)
    uw, vw = (u * w).sum(0), (v * w).sum(0)
    s = np.clip((uv * vw - uw * vv) / np.maximum(uu * vv - uv * uv, 1e-9), 0, 1)
    t = np.clip((uv * s + vw) / np.maximum(vv, 1e-9), 0, 1)
    s = np.clip((uv * t - uw) / np.maximum(uu, 1e-9), 0, 1)
    return s, t, np.sqrt(((w + s * u - t * v) ** 2).sum(0))


def cut_normal(rng: np.random.Generator, shape: tuple[int, ...], cut: float) -> Array:
    """Standard normal numbers, those beyond ``cut`` moved there."""
    return np.clip(rng.standard_normal(shape), -cut, cut)


def _unit(v: Array) -> Array:
    """Vectors (N, 2 or 3) scaled to length 1."""
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))
