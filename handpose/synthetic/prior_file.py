"""The prior file: the distribution of poses, positions and sizes of a body, as text next to its
skeleton file.

``prototxt/hand/nyu_prior.prototxt`` is that of the hand; other bodies have other files. Angles
of ``turn`` are in degrees and of the whole DoF (input + initial); all other values of DoFs are
fractions of the range between the limits of its input, 0 at the lower and 1 at the upper.
Lengths are in mm.

    turn        orientation of the body as a whole: normal, or for a fraction of bodies any angle
    proportion  bones that are longer or shorter together, such as all of a limb
    bend        chains of DoFs that bend together, such as the joints of a limb
    spread      DoFs about their initial value: normal
    between     DoFs anywhere between their limits: Beta
    pose        poses with a name; ``blend`` of all bodies are somewhere between two of them
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import CAMERAS
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import NYU_HAND, Skeleton
from netlib.errors import PrototxtError, did_you_mean
from netlib.files.paths import exists, find, real
from netlib.proto import prototxt, schema
from netlib.proto.schema import Double

MAX_DISTANCE_MM = 1e5  # range of depth cameras
MAX_REDRAWS = 1000
NYU_PRIOR = NYU_HAND.with_name("nyu_prior.prototxt")
PEOPLE_PRIOR = NYU_HAND.with_name("people_prior.prototxt")


@dataclass(frozen=True)
class NormalParameter:
    """A normal distribution."""

    mean: Double = 0.0
    std: Double = 0.0


@dataclass(frozen=True)
class RangeParameter:
    """A uniform distribution."""

    low: Double
    high: Double


@dataclass(frozen=True)
class BetaParameter:
    """A Beta distribution, on 0 to 1."""

    a: Double = 1.0
    b: Double = 1.0


@dataclass(frozen=True)
class TurnParameter:
    """A ``turn { ... }``: an angle of the whole body, degrees.

    any     fraction of bodies with any angle instead of a normal one
    evenly  such angles are from -90 to 90, with a uniform sine. As the second of three turns that
            are any, every direction is then as likely as any other
    most    largest absolute value
    """

    dof: str
    mean: Double = 0.0
    std: Double = 0.0
    any: Double | None = None
    evenly: bool = False
    most: Double = np.inf


@dataclass(frozen=True)
class ChainParameter:
    """A ``chain { ... }`` of a ``bend``: DoFs from one body part to its end."""

    name: str
    dof: tuple[str, ...]


@dataclass(frozen=True)
class BendParameter:
    """A ``bend { ... }``: chains whose DoFs share how far they are bent, 0 straight to 1.

    straight     the limit at which a DoF is straight
    shared       how far all chains of a body are bent
    independent  fraction of bodies with another number for each chain
    own          how far each of their chains is bent
    noise        normal, of each DoF about its chain's
    """

    chain: tuple[ChainParameter, ...]
    straight: Literal["LOWER", "UPPER"] = "LOWER"
    shared: BetaParameter = BetaParameter()
    independent: Double = 0.0
    own: BetaParameter = BetaParameter()
    noise: Double = 0.0


@dataclass(frozen=True)
class SpreadParameter:
    """A ``spread { ... }``: DoFs about their initial value."""

    dof: tuple[str, ...]
    noise: Double  # normal, of the range


@dataclass(frozen=True)
class BetweenParameter:
    """A ``between { ... }``: DoFs anywhere between their limits, each independently."""

    dof: tuple[str, ...]
    a: Double = 1.0  # Beta
    b: Double = 1.0


@dataclass(frozen=True)
class ProportionParameter:
    """A ``proportion { ... }``: bones that differ together from those of the skeleton."""

    joint: tuple[str, ...]  # the bones that end there
    std: Double  # normal, of the common factor about 1


@dataclass(frozen=True)
class PosePartParameter:
    """The bend of a chain in a pose, or the position of a DoF between its limits."""

    of: str
    part: Double


@dataclass(frozen=True)
class PoseParameter:
    """A ``pose { ... }`` with a name. Other DoFs have their initial value."""

    name: str
    bend: tuple[PosePartParameter, ...] = ()
    at: tuple[PosePartParameter, ...] = ()


@dataclass(frozen=True)
class CenterParameter:
    """The ``center { ... }``: the middle of crops, in the frame of a joint, mm."""

    joint: str
    x: Double = 0.0
    y: Double = 0.0
    z: Double = 0.0


@dataclass(frozen=True)
class PosePrior:
    """A whole prior file."""

    skeleton: str  # its file, in the prior's folder
    cube_mm: Double  # edge of the crops; the skeleton's length unit is half of it
    depth: RangeParameter  # range of the centre's depth
    camera: str = "nyu"  # name of the frames' camera
    center: CenterParameter | None = None  # none: the origin of the skeleton
    center_jitter: Double = 0.0  # normal, each axis
    center_jitter_wide: Double = 0.0  # the same for the fraction ``wide``
    wide: Double = 0.0
    lateral_x: NormalParameter = NormalParameter()  # x / z of the centre
    lateral_y: NormalParameter = NormalParameter()  # y / z of the centre
    turn: tuple[TurnParameter, ...] = ()
    bend: tuple[BendParameter, ...] = ()
    spread: tuple[SpreadParameter, ...] = ()
    between: tuple[BetweenParameter, ...] = ()
    pose: tuple[PoseParameter, ...] = ()
    # fraction of bodies that are between two poses, at a uniform part of the way
    blend: Double = 0.0
    blend_noise: Double = 0.0  # normal, of each DoF of these, relative to its range
    penetration: Double = np.inf  # maximum penetration of parts; deeper ones are drawn again
    redraws: int = 8  # maximum number of draws
    scale_mean: Double = 1.0  # normal: size of the whole body, relative to the skeleton
    scale_std: Double = 0.0
    # groups of bones, relative to the body's size
    proportion: tuple[ProportionParameter, ...] = ()
    bone_std: Double = 0.0  # normal: each bone independently
    scale_clip: Double = 2.5  # sizes are clipped at this many standard deviations

    def turned(self, dof: str, **changes: float | None) -> PosePrior:
        """A copy with other numbers of one ``turn``."""
        return self.but(
            turn=tuple(schema.changed(t, **changes) if t.dof == dof else t for t in self.turn)
        )

    def but(self, **changes: Any) -> PosePrior:
        """A copy with other numbers."""
        return schema.changed(self, **changes)

    def body(self) -> Skeleton:
        """The skeleton. Raises PrototxtError, NetlibError."""
        place = schema.position_of(self, "skeleton")
        sibling = Path(place.source).parent / self.skeleton
        return skeletons.load(
            sibling if self.skeleton and exists(sibling) else find(self.skeleton, place.source)
        )


def load(path: str | Path = NYU_PRIOR) -> PosePrior:
    """The prior of a file; by default that of the NYU hand. Raises PrototxtError, NetlibError."""
    return _load(Path(path), real(path))


@functools.lru_cache(maxsize=16)
def _load(path: Path, whole_path: Path) -> PosePrior:
    tree = prototxt.parse_file(path)
    for field in tree.fields:
        if field.name == "joint":
            advice = f'a prior file, which names it: skeleton: "{path.name}" (docs/bodies.md)'
            raise PrototxtError(field.position, f"found a skeleton; expected {advice}")
    prior = schema.read(tree, PosePrior, f"prior {path}")
    _check(prior)
    return prior


class Bounds(NamedTuple):
    """The lowest and the highest value of a number, and both in words."""

    low: float
    high: float
    in_words: str


ABOVE_ZERO = math.ulp(0.0)
MAX_FINITE = sys.float_info.max
DEVIATION = Bounds(0, MAX_DISTANCE_MM, f"0 or more, up to {MAX_DISTANCE_MM:g}")
DISTANCE = Bounds(
    -MAX_DISTANCE_MM,
    MAX_DISTANCE_MM,
    f"a number between -{MAX_DISTANCE_MM:g} and {MAX_DISTANCE_MM:g}",
)
FRACTION = Bounds(0, 1, "a fraction, 0 to 1")
NOT_NEGATIVE = Bounds(0, math.inf, "0 or more")
# of the fields of these names, in any message
BOUNDS = {
    **dict.fromkeys(("std", "noise", "blend_noise", "scale_std", "bone_std"), DEVIATION),
    **dict.fromkeys(("center_jitter", "center_jitter_wide"), DEVIATION),
    **dict.fromkeys(("mean", "x", "y", "z"), DISTANCE),
    **dict.fromkeys(("most", "scale_clip"), NOT_NEGATIVE),
    **dict.fromkeys(("any", "independent", "wide", "blend"), FRACTION),
    "part": Bounds(0, 1, "a part of the range, 0 to 1"),
    "penetration": Bounds(-math.inf, math.inf, "a depth in mm"),
    "scale_mean": Bounds(ABOVE_ZERO, MAX_DISTANCE_MM, "a factor above 0"),
    "cube_mm": Bounds(ABOVE_ZERO, MAX_FINITE, "a length in mm > 0"),
    "redraws": Bounds(1, MAX_REDRAWS, f"1 to {MAX_REDRAWS}"),
}


def _check(prior: PosePrior) -> None:
    """Raise PrototxtError for invalid numbers and unknown names."""
    _expect_known(prior, "camera", prior.camera, CAMERAS)
    for message in messages(prior):
        _check_numbers(message)
    for message, name, mean in (
        (prior, "scale_std", prior.scale_mean),
        (prior, "bone_std", 1.0),
        *((group, "std", 1.0) for group in prior.proportion),
    ):
        std = getattr(message, name)
        are_above = not std or std * prior.scale_clip < mean
        expect(message, name, are_above, "less than 1 / scale_clip, so that none is below 0")
    Named(prior, prior.body())
    alone: list[Any] = [*prior.spread, *prior.between]
    known = [dof for message in alone for dof in message.dof]
    for part in (part for pose in prior.pose for part in pose.at):
        _expect_known(part, "of", part.of, known)


def messages(message: Any) -> Iterator[Any]:
    """The message and all messages in it."""
    yield message
    for field in fields(message):
        value = getattr(message, field.name)
        for part in value if isinstance(value, tuple) else (value,):
            if is_dataclass(part):
                yield from messages(part)


def _check_numbers(message: Any) -> None:
    """Check each number of a message alone, and ranges and Beta distributions."""
    for name, bounds in BOUNDS.items():
        value = getattr(message, name, None)
        if value is not None:
            expect(message, name, bounds.low <= value <= bounds.high, bounds.in_words)
    if isinstance(message, RangeParameter):
        is_range = 0 < message.low <= message.high <= MAX_DISTANCE_MM
        expect(message, "low", is_range, f"0 < low <= high <= {MAX_DISTANCE_MM:g}, in mm")
    elif isinstance(message, (BetaParameter, BetweenParameter)):
        expect(message, "a", 0 < message.a < np.inf and 0 < message.b < np.inf, "a and b > 0")


Bent = tuple[Literal["LOWER", "UPPER"], NDArray[np.int_]]  # the limit of straight DoFs, and these


class Named:
    """What a prior names of a skeleton, as indices. Raises PrototxtError for what is unknown, is
    drawn twice, or has no limits where they are needed.

    rotation     DoFs of the turns
    translation  DoFs along x, y, z of the joint with the crop centre; none without a centre
    chains       DoFs of each chain of each bend
    spread, between  DoFs of each of these messages
    groups       joints of each proportion
    poses        by name: what is bent, and by which fractions
    """

    def __init__(self, prior: PosePrior, skeleton: Skeleton) -> None:
        self._skeleton, self._file = skeleton, prior.skeleton
        self._drawn: set[int] = set()
        self.groups = [
            [self._joint(group, one) for one in group.joint] for group in prior.proportion
        ]
        self.translation = self._translation(prior)
        self.rotation = [self._dof(turn, turn.dof) for turn in prior.turn]
        self.chains = [[self._limb(chain) for chain in bend.chain] for bend in prior.bend]
        self.spread = [self._limb(spread) for spread in prior.spread]
        self.between = [self._limb(between) for between in prior.between]
        chains: dict[str, Bent] = {
            chain.name: (bend.straight, dofs)
            for bend, own in zip(prior.bend, self.chains)
            for chain, dofs in zip(bend.chain, own)
        }
        dofs: dict[str, Bent] = {
            name: ("LOWER", np.array([d])) for d, name in enumerate(skeleton.dof_names)
        }
        self.poses: dict[str, list[tuple[Bent, float]]] = {}
        for pose in prior.pose:
            expect(pose, "name", pose.name not in self.poses, f"pose {pose.name!r} once")
            self.poses[pose.name] = [*_parts(pose.bend, chains), *_parts(pose.at, dofs)]
        expect(prior, "blend", not prior.blend or bool(prior.pose), "a pose { ... } to be between")

    def _joint(self, message: object, name: str) -> int:
        _expect_known(message, "joint", name, self._skeleton.joint_names)
        return self._skeleton.joint_names.index(name)

    def _dof(self, message: object, name: str) -> int:
        _expect_known(message, "dof", name, self._skeleton.dof_names)
        d = self._skeleton.dof_names.index(name)
        expect(message, "dof", d not in self._drawn, f"DoF {name!r} once")
        expect(message, "dof", not self._skeleton.fixed[d], f"no fixed DoF such as {name!r}")
        self._drawn.add(d)
        return d

    def _limb(
        self, message: ChainParameter | SpreadParameter | BetweenParameter
    ) -> NDArray[np.int_]:
        """The DoFs of a message, which need limits."""
        skeleton = self._skeleton
        dofs = [self._dof(message, name) for name in message.dof]
        for d in dofs:
            is_bounded = bool(np.isfinite([skeleton.lower[d], skeleton.upper[d]]).all())
            expected = f"limits of DoF {skeleton.dof_names[d]!r} in {self._file}"
            expect(message, "dof", is_bounded, expected)
        return np.array(dofs, dtype=int)

    def _translation(self, prior: PosePrior) -> list[int]:
        """Raises unless the centre of crops is on a joint that moves the whole body."""
        if prior.center is None:
            for name in ("center_jitter", "center_jitter_wide"):
                expect(prior, name, not getattr(prior, name), "a center { ... } to be away from")
            return []
        joint = self._joint(prior.center, prior.center.joint)
        along = {
            motion.axis: motion.dof
            for motion in self._skeleton.motions[joint]
            if motion.kind == "translate" and motion.sign > 0 and motion.row >= 0
        }
        moves_body = self._skeleton.parents[joint] < 0 and len(along) == 3
        expected = "one without a parent that translates along X, Y and Z"
        expect(prior.center, "joint", moves_body, expected)
        return [along[axis] for axis in range(3)]


def _parts(
    parts: Sequence[PosePartParameter], known: Mapping[str, Bent]
) -> Iterator[tuple[Bent, float]]:
    """What the parts of a pose are of, each once."""
    names: set[str] = set()
    for part in parts:
        _expect_known(part, "of", part.of, known)
        expect(part, "of", part.of not in names, f"{part.of!r} once in a pose")
        names.add(part.of)
        yield known[part.of], part.part


def expect(message: object, field: str, holds: bool, expected: str) -> None:
    """Raise PrototxtError at a message's field, with what was expected, unless it ``holds``."""
    if not holds:
        raise PrototxtError(schema.position_of(message, field), f"{field}: expected {expected}")


def _expect_known(message: object, field: str, name: str, known: Collection[str]) -> None:
    if name not in known:
        advice = did_you_mean(name, known) or f"; expected one of {', '.join(known)}"
        raise PrototxtError(schema.position_of(message, field), f"unknown {field} {name!r}{advice}")
