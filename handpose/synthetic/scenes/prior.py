"""The scene prior: how often whole scenes show what, how large and where, as text.

``prototxt/hand/scene_prior.prototxt`` is that of the finder's training. Lengths are in mm, angles
in degrees, shares and chances between 0 and 1.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from handpose.synthetic.prior_file import NYU_PRIOR, messages
from handpose.synthetic.prior_names import expect
from handpose.synthetic.scenes.draws import Range, Sizes
from netlib.files.paths import real
from netlib.proto import prototxt, schema
from netlib.proto.schema import Double

SCENE_PRIOR = NYU_PRIOR.with_name("scene_prior.prototxt")
Shape = Literal["BOX", "CYLINDER", "ELLIPSOID"]
Standing = Literal["TABLE", "AIR", "ROOM"]


NOWHERE = Range(0.0, 0.0)


@dataclass(frozen=True)
class ViewParameter:
    """The ``view { ... }``: cameras."""

    focal: Range  # of ``FINDER_FOCAL_PX``
    shift_x: Double  # px: largest distance of the principal point from the frame's middle
    shift_y: Double
    on_head: Double  # share of cameras that a person wears
    facing: Double  # share of cameras in front of the person
    pitch: Range  # downwards
    pitch_on_head: Range
    roll: Double  # deviation ...
    any_roll: Double  # ... but for this share: any
    any_roll_on_head: Double


@dataclass(frozen=True)
class HandsParameter:
    """The ``hands { ... }``: how many, where, and how they lie."""

    none: Double  # share of scenes without a hand
    second: Double  # share of the others with two
    distance: Sizes  # of the first hand from the camera's plane
    margin_px: Double  # from the frame's border
    rests: Double  # share that lies on the table, palm down ...
    rests_mm: Range  # ... by so much below the palm's middle
    along: Double  # share that is seen along the arm
    stranger: Double  # share of second hands of another person
    close: Double  # share of second hands near the first ...
    close_mm: Range  # ... at this distance


@dataclass(frozen=True)
class ArmParameter:
    """The ``arm { ... }``: forearm, sleeve and upper arm."""

    thickness: Range  # of the body's
    cut: Double  # share that ends early ...
    cut_at: Range  # ... at this part of the forearm
    sleeve: Double  # share that wears one ...
    sleeve_from: Range  # ... from this part of the forearm on
    sleeve_mm: Range  # ... so thick
    upper: Range  # radius of the upper arm
    without_hand: Double  # share of second arms whose hand is not there


@dataclass(frozen=True)
class BodyParameter:
    """The ``body { ... }``: trunk, shoulders, head, legs of the person."""

    share: Double
    width: Range  # of the usual
    legs: Double  # share that sits


@dataclass(frozen=True)
class TableParameter:
    """The ``table { ... }``."""

    share: Double
    near: Double  # share that is close below a hand ...
    near_mm: Range
    below_mm: Range  # ... otherwise
    tilt: Double  # deviation, part of a right angle
    ahead: Range  # of its middle from the hand
    aside: Range
    half: Range  # half of its length and width
    thickness: Double  # half


@dataclass(frozen=True)
class HeldParameter:
    """The ``held { ... }``: what a hand holds."""

    share: Double
    away: Range  # of its middle from the palm's
    along: Range  # towards the fingers
    length: Range  # half
    touches: Double  # share that ends at the fingers; others pass through them
    flatness: Range  # depth of boxes and ellipsoids, of their radius
    top: Double  # share of cylinders with another one on top, such as a bottle's neck ...
    top_width: Range  # ... of the radius
    top_length: Range


@dataclass(frozen=True)
class PlanesParameter:
    """The ``planes { ... }``: floor and walls."""

    floor: Double  # share
    floor_below: Range
    wall: Double
    wall_behind: Range
    wall_tilt: Double  # deviation, part of a right angle
    beside: Double
    beside_away: Range


@dataclass(frozen=True)
class LightParameter:
    """The ``light { ... }``: what a camera reads."""

    range: Double  # share of cameras that end a little behind the hand ...
    range_behind: Sizes  # ... by this
    reflects: Sizes  # part of the light that things send back
    people_reflect: Sizes  # clothes and hair


@dataclass(frozen=True)
class PartParameter:
    """A ``part { ... }`` of a thing: a solid in the thing's own axes.

    x to the right, y up, z to the front; the origin stands on the table. A cylinder's length lies
    along y.
    """

    shape: Shape
    x: Sizes  # half lengths
    y: Sizes
    z: Sizes | None = None  # as x
    at_x: Range = NOWHERE  # the middle
    at_y: Range | None = None  # it stands on the ground
    at_z: Range = NOWHERE
    tilt: Range = NOWHERE  # turned about x, so that its top comes forward
    lean: Range = NOWHERE  # turned about z
    chance: Double = 1.0  # that a thing has it


@dataclass(frozen=True)
class ThingParameter:
    """A ``thing { ... }``."""

    name: str
    share: Double  # of all things, relative to the other shares
    part: tuple[PartParameter, ...]
    stands: Standing = "TABLE"  # on the table (or nowhere), in the air, upright in the room
    size: Sizes = Sizes(1.0, 1.0)  # of all its lengths
    lies: Double = 0.0  # share of those on a table that lie on a side


@dataclass(frozen=True)
class ThingsParameter:
    """The ``things { ... }``: what stands around."""

    share: Double  # of scenes with any
    most: int  # number of things in a scene
    each: Double  # chance of each of them
    on_table: Range  # distance from the hand along the table
    in_air: Range  # from the hand
    in_room: Sizes
    thing: tuple[ThingParameter, ...]


@dataclass(frozen=True)
class HiddenParameter:
    """The ``hidden { ... }``: what hides a larger part of the first hand is left out."""

    body: Double
    table: Double
    things: Double
    planes: Double


@dataclass(frozen=True)
class ScenePrior:
    """A whole file."""

    view: ViewParameter
    hands: HandsParameter
    arm: ArmParameter
    body: BodyParameter
    table: TableParameter
    held: HeldParameter
    planes: PlanesParameter
    light: LightParameter
    things: ThingsParameter
    hidden: HiddenParameter


@functools.lru_cache(maxsize=4)
def load(path: str | Path = SCENE_PRIOR) -> ScenePrior:
    """The prior of a file. Raises PrototxtError, NetlibError."""
    prior = schema.read(prototxt.parse_file(real(path)), ScenePrior, f"scene prior {path}")
    for message in messages(prior):
        if isinstance(message, Sizes):
            expect(message, "low", 0 < message.low <= message.high, "0 < low <= high")
        elif isinstance(message, Range):
            expect(message, "low", message.low <= message.high, "low <= high")
        elif isinstance(message, ThingParameter):
            expect(message, "share", message.share > 0, "a share above 0")
    return prior
