"""Scripts of synthetic recordings: hands, their persons and their acts."""

from __future__ import annotations

from dataclasses import dataclass, replace

from handpose.body.sides import Side, other_side
from handpose.sequences.acts import Act
from handpose.sequences.gestures import SHOWN
from handpose.synthetic.prior_file import PoseParameter


@dataclass(frozen=True)
class Role:
    """One hand.

    side    "right" or "left"
    acts    repeated until the recording ends
    person  index of its person: hands of one person have the same bones and surface
    """

    side: Side
    acts: tuple[Act, ...]
    person: int = 0


@dataclass(frozen=True)
class Script:
    """The script of a recording.

    seconds  default length
    roles    the hands; their indices are their ids
    body     True if the body of the first person is visible behind the hands, False for arms only
    desk     True if the first person sits at a table and is seen from above
    apart    True if each of two hands keeps to its half of the image, False if one may occlude the other
    poses    replace those of the prior file with the same names
    """

    seconds: float
    roles: tuple[Role, ...]
    body: bool = False
    desk: bool = False
    apart: bool = True
    poses: tuple[PoseParameter, ...] = ()

    def mirrored(self) -> Script:
        """The script with left and right hands exchanged."""
        return replace(self, roles=tuple(replace(role, side=other_side(role.side)) for role in self.roles))


_LIVELY = (Act("moving", 6), Act("rest", 1.5), Act("gestures", 6), Act("wave", 2.5), Act("rest", 1.5))
SCRIPTS = {
    "rest": Script(10, (Role("right", (Act("rest", 10),)),)),
    "gestures": Script(20, (Role("right", (Act("gestures", 16), Act("wave", 3), Act("rest", 1.5))),)),
    "moving": Script(20, (Role("right", (Act("rest", 1.5), Act("moving", 18.5))),)),
    "leaves": Script(20, (Role("right", (Act("moving", 4), Act("away", 3.5), Act("gestures", 3))),)),
    "two_hands": Script(20, (Role("right", _LIVELY), Role("left", (*_LIVELY[2:], *_LIVELY[:2])))),
    "two_people": Script(20, (Role("right", _LIVELY), Role("right", (*_LIVELY[2:], *_LIVELY[:2]), person=1))),
    "left": Script(20, (Role("left", _LIVELY),)),
    "body": Script(20, (Role("right", _LIVELY),), body=True),
    "desk": Script(20, (Role("right", _LIVELY), Role("left", (*_LIVELY[2:], *_LIVELY[:2]))), desk=True),
    "minute": Script(
        60,
        (
            Role("right", (Act("rest", 2), Act("gestures", 10), Act("moving", 11), Act("away", 4), *_LIVELY, *_LIVELY)),
            Role("left", (Act("away", 30), *_LIVELY, Act("away", 20))),
        ),
        body=True,
    ),
}
# A hand that shows the gestures of handpose/body/gestures.
SHOWING = Script(30, (Role("right", (Act("gestures", 30, tuple(pose.name for pose in SHOWN)),)),), poses=SHOWN)
