"""The messages of a prior file (``prior_file``)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib.files.paths import exists, find
from netlib.proto import schema
from netlib.proto.schema import Double


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
