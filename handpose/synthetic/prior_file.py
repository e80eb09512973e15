"""The prior file: the distribution of poses, positions and sizes of a body, as text next to its skeleton file.

``prototxt/hand/nyu_prior.prototxt`` is that of the hand; other bodies have other files. Angles of ``turn`` are in
degrees and of the whole DoF (input + initial); all other values of DoFs are fractions of the range between the limits
of its input, 0 at the lower and 1 at the upper. Lengths are in mm.

    turn     orientation of the body as a whole: normal, or for a fraction of bodies any angle
    proportion  bones that are longer or shorter together, such as all of a limb
    bend     chains of DoFs that bend together, such as the joints of a limb
    spread   DoFs about their initial value: normal
    between  DoFs anywhere between their limits: Beta
    pose     poses with a name; ``blend`` of all bodies are somewhere between two of them
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from handpose.frames.cameras import CAMERAS
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import NYU_HAND, Skeleton
from netlib.errors import PrototxtError, did_you_mean
from netlib.files.paths import exists, find
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
    """A ``turn { ... }``: an angle of the whole body, degrees."""

    dof: str
    mean: Double = 0.0
    std: Double = 0.0
    any: Double | None = None  # this fraction of bodies: any angle ...
    evenly: bool = False  # ... from -90 to 90 with a uniform sine: as the second of three turns that are any, every
    # direction is then as likely as any other
    most: Double = np.inf  # largest absolute value


@dataclass(frozen=True)
class ChainParameter:
    """A ``chain { ... }`` of a ``bend``: DoFs from one body part to its end."""

    name: str
    dof: tuple[str, ...]


@dataclass(frozen=True)
class BendParameter:
    """A ``bend { ... }``: chains whose DoFs share how far they are bent, 0 straight to 1."""

    chain: tuple[ChainParameter, ...]
    straight: Literal["LOWER", "UPPER"] = "LOWER"  # the limit at which a DoF is straight
    shared: BetaParameter = BetaParameter()  # how far all chains of a body are bent; but ...
    independent: Double = 0.0  # ... this fraction of bodies has ...
    own: BetaParameter = BetaParameter()  # ... another number for each chain
    noise: Double = 0.0  # normal, of each DoF about its chain's


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
class PartParameter:
    """The bend of a chain in a pose, or the position of a DoF between its limits."""

    of: str
    part: Double


@dataclass(frozen=True)
class PoseParameter:
    """A ``pose { ... }`` with a name. Other DoFs have their initial value."""

    name: str
    bend: tuple[PartParameter, ...] = ()
    at: tuple[PartParameter, ...] = ()


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
    center_jitter_wide: Double = 0.0  # the same ...
    wide: Double = 0.0  # ... for this fraction
    lateral_x: NormalParameter = NormalParameter()  # x / z of the centre
    lateral_y: NormalParameter = NormalParameter()  # y / z of the centre
    turn: tuple[TurnParameter, ...] = ()
    bend: tuple[BendParameter, ...] = ()
    spread: tuple[SpreadParameter, ...] = ()
    between: tuple[BetweenParameter, ...] = ()
    pose: tuple[PoseParameter, ...] = ()
    blend: Double = 0.0  # this fraction of bodies is between two poses, at a uniform part of the way ...
    blend_noise: Double = 0.0  # ... but for this: normal, of each DoF's range
    penetration: Double = np.inf  # maximum penetration of parts; deeper ones are drawn again
    redraws: int = 8  # maximum number of draws
    scale_mean: Double = 1.0  # normal: the whole body, relative to the skeleton ...
    scale_std: Double = 0.0
    proportion: tuple[ProportionParameter, ...] = ()  # ... groups of bones, relative to the body's size ...
    bone_std: Double = 0.0  # ... and each bone independently
    scale_clip: Double = 2.5  # all are clipped at this many standard deviations

    def turned(self, dof: str, **changes: float | None) -> PosePrior:
        """A copy with other numbers of one ``turn``."""
        return self.but(turn=tuple(schema.changed(t, **changes) if t.dof == dof else t for t in self.turn))

    def but(self, **changes: Any) -> PosePrior:
        """A copy with other numbers."""
        return schema.changed(self, **changes)

    def body(self) -> Skeleton:
        """The skeleton. Raises PrototxtError, NetlibError."""
        place = schema.position_of(self, "skeleton")
        sibling = Path(place.source).parent / self.skeleton
        return skeletons.load(sibling if self.skeleton and exists(sibling) else find(self.skeleton, place.source))


def load(path: str | Path = NYU_PRIOR) -> PosePrior:
    """The prior of a file; by default that of the NYU hand. Raises PrototxtError, NetlibError."""
    return _load(Path(path), Path(os.path.realpath(path)))


@functools.lru_cache(maxsize=16)
def _load(path: Path, whole_path: Path) -> PosePrior:
    prior = schema.read(prototxt.parse_file(path), PosePrior, f"prior {path}")
    _check(prior)
    return prior


def _check(prior: PosePrior) -> None:
    """Raise PrototxtError for invalid numbers and unknown names."""
    skeleton = prior.body()
    if prior.camera not in CAMERAS:
        raise _unknown(prior, "camera", prior.camera, CAMERAS)
    if prior.center is not None and prior.center.joint not in skeleton.joint_names:
        raise _unknown(prior.center, "joint", prior.center.joint, skeleton.joint_names)
    normals = (prior.lateral_x, prior.lateral_y)
    drawn: tuple[object, ...] = (
        prior,
        *normals,
        *prior.turn,
        *prior.bend,
        *prior.spread,
        *prior.between,
        *prior.proportion,
    )
    for message in (*drawn, *(prior.center,) * (prior.center is not None)):
        _check_numbers(message)
    _check_sizes(prior, skeleton)
    _check_center(prior, skeleton)
    bent = [part for bend in prior.bend for part in (bend.shared, bend.own)]
    betas: list[BetweenParameter | BetaParameter] = [*prior.between, *bent]
    for beta in betas:
        _expect(beta, "a", 0 < beta.a < np.inf and 0 < beta.b < np.inf, "a and b > 0")
    _expect(prior, "cube_mm", 0 < prior.cube_mm < np.inf, "a length in mm > 0")
    _expect(
        prior.depth,
        "low",
        0 < prior.depth.low <= prior.depth.high <= MAX_DISTANCE_MM,
        f"0 < low <= high <= {MAX_DISTANCE_MM:g}, in mm",
    )
    _expect(prior, "redraws", 0 < prior.redraws <= MAX_REDRAWS, f"1 to {MAX_REDRAWS}")
    _check_dofs(prior, skeleton)
    _check_poses(prior, skeleton)


def _check_numbers(message: object) -> None:
    """Check that deviations are 0 or more, fractions 0 to 1, and positions and angles possible for a camera."""
    for name, value in vars(message).items():
        if name in ("std", "noise", "blend_noise", "scale_std", "bone_std") or name.startswith("center_jitter"):
            _expect(message, name, 0 <= value <= MAX_DISTANCE_MM, f"0 or more, up to {MAX_DISTANCE_MM:g}")
        elif name in ("mean", "x", "y", "z"):
            expected = f"a number between -{MAX_DISTANCE_MM:g} and {MAX_DISTANCE_MM:g}"
            _expect(message, name, abs(value) <= MAX_DISTANCE_MM, expected)
        elif name in ("most", "scale_clip"):
            _expect(message, name, value >= 0, "0 or more")
        elif name == "penetration":
            _expect(message, name, not np.isnan(value), "a depth in mm")
        elif name == "scale_mean":
            _expect(message, name, 0 < value <= MAX_DISTANCE_MM, "a factor above 0")
        elif name in ("any", "independent", "wide", "blend") and value is not None:
            _expect(message, name, 0 <= value <= 1, "a fraction, 0 to 1")


def _check_sizes(prior: PosePrior, skeleton: Skeleton) -> None:
    """Check that no size or bone length can be drawn below 0."""
    expected = "less than 1 / scale_clip, so that none is below 0"
    _expect(prior, "scale_std", not prior.scale_std or prior.scale_std * prior.scale_clip < prior.scale_mean, expected)
    _expect(prior, "bone_std", not prior.bone_std or prior.bone_std * prior.scale_clip < 1, expected)
    for group in prior.proportion:
        _expect(group, "std", not group.std or group.std * prior.scale_clip < 1, expected)
        for joint in group.joint:
            if joint not in skeleton.joint_names:
                raise _unknown(group, "joint", joint, skeleton.joint_names)


def _check_center(prior: PosePrior, skeleton: Skeleton) -> None:
    """Raise unless the centre of crops is on a joint that moves the whole body, as required."""
    if prior.center is None:
        for name in ("center_jitter", "center_jitter_wide"):
            _expect(prior, name, not getattr(prior, name), "a center { ... } to be away from")
        return
    joint = skeleton.joint_names.index(prior.center.joint)
    carries = skeleton.parents[joint] < 0 and len(translations(skeleton, joint)) == 3
    _expect(prior.center, "joint", carries, "one without a parent that translates along X, Y and Z")


def translations(skeleton: Skeleton, joint: int) -> dict[int, int]:
    """The free DoFs that move a joint along x, y, z (0, 1, 2) of its parent."""
    own = skeleton.motions[joint]
    return {m.axis: m.dof for m in own if m.kind == "translate" and m.sign > 0 and m.row >= 0}


def _check_dofs(prior: PosePrior, skeleton: Skeleton) -> None:
    """Check that every DoF exists and is drawn once, and that those that need limits have them."""
    chains = [chain for bend in prior.bend for chain in bend.chain]
    turned: list[tuple[object, str]] = [(turn, turn.dof) for turn in prior.turn]
    several: list[ChainParameter | SpreadParameter | BetweenParameter] = [*chains, *prior.spread, *prior.between]
    limited: list[tuple[object, str]] = [(message, dof) for message in several for dof in message.dof]
    seen: set[str] = set()
    for message, dof in (*turned, *limited):
        if dof not in skeleton.dof_names:
            raise _unknown(message, "dof", dof, skeleton.dof_names)
        _expect(message, "dof", dof not in seen, f"DoF {dof!r} once")
        d = skeleton.dof_names.index(dof)
        _expect(message, "dof", not skeleton.fixed[d], f"no fixed DoF such as {dof!r}")
        seen.add(dof)
    for message, dof in limited:
        d = skeleton.dof_names.index(dof)
        bounded = np.isfinite(skeleton.lower[d]) and np.isfinite(skeleton.upper[d])
        _expect(message, "dof", bool(bounded), f"limits of DoF {dof!r} in {prior.skeleton}")


def _check_poses(prior: PosePrior, skeleton: Skeleton) -> None:
    """Check that the chains and DoFs of poses exist, and that values are fractions of their ranges."""
    chains = [chain.name for bend in prior.bend for chain in bend.chain]
    drawn = [dof for spread in prior.spread for dof in spread.dof]
    drawn += [dof for between in prior.between for dof in between.dof]
    names: set[str] = set()
    for pose in prior.pose:
        _expect(pose, "name", pose.name not in names, f"pose {pose.name!r} once")
        names.add(pose.name)
        for parts, known in ((pose.bend, chains), (pose.at, drawn)):
            for i, part in enumerate(parts):
                if part.of not in known:
                    raise _unknown(part, "of", part.of, known)
                _expect(part, "of", part.of not in [other.of for other in parts[:i]], f"{part.of!r} once in a pose")
                _expect(part, "part", 0 <= part.part <= 1, "a part of the range, 0 to 1")
    _expect(prior, "blend", not prior.blend or bool(prior.pose), "a pose { ... } to be between")


def _expect(message: object, field: str, true: bool, expected: str) -> None:
    if not true:
        raise PrototxtError(schema.position_of(message, field), f"{field}: expected {expected}")


def _unknown(message: object, field: str, name: str, known: Iterable[str]) -> PrototxtError:
    advice = did_you_mean(name, known) or f"; expected one of {', '.join(known)}"
    return PrototxtError(schema.position_of(message, field), f"unknown {field} {name!r}{advice}")
