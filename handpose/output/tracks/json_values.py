"""The header and the frames of a track as JSON values, and back;
docs/hands.schema.json has the keys.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from handpose.body.gestures import GestureReader
from handpose.body.joint_formats.formats import FormatName
from handpose.body.model import FINGERS
from handpose.body.sides import SIDES
from handpose.fit.pose_confidence import unknown_finger_errors
from handpose.frames.cameras import MIN_RANGE_MM, Camera
from handpose.output.tracks import joint_values
from handpose.output.tracks.fields import Fields
from handpose.tracking.track import LostHand, PresentHand, TrackedFrame, TrackedHand, TrackHeader
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter, text_of
from netlib.blob import Array
from netlib.errors import DataError
from netlib.proto import prototxt, schema

FORMAT, FORMAT_VERSION = "handpose", 2
READABLE_VERSIONS = (1, 2)  # versions; without presence before 2
UNITS = {"length": "mm", "angle": "rad", "time": "s", "pixel": "px"}
AXES = {"x": "right", "y": "up", "z": "away from the camera"}


to_text = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode  # ASCII only


def rounded(numbers: ArrayLike, decimals: int) -> Any:
    """A number or lists of numbers; None for unknown ones."""
    if isinstance(numbers, float):  # the frequent case
        return round(float(numbers), decimals) + 0.0 if math.isfinite(numbers) else None
    array = np.asarray(numbers, dtype=np.float64)
    values = (array.round(decimals) + 0.0).tolist()  # + 0.0: no -0.0
    return values if np.isfinite(array).all() else _nulled(values)


def _known(numbers: Array, decimals: int) -> Any:
    """``rounded``, but one None if any number is unknown."""
    return rounded(numbers, decimals) if np.isfinite(numbers).all() else None


def _nulled(values: Any) -> Any:
    if isinstance(values, list):
        return [_nulled(value) for value in values]
    return values if math.isfinite(values) else None


# --------------------------------------------------------------------------------------- the header


def header_values(
    header: TrackHeader, joints: FormatName | None = None, *, in_frames: bool = True
) -> dict[str, Any]:
    """The header as an object; ``joints`` is an additional format of hands.

    ``in_frames`` as for ``FrameValues``.
    """
    camera = {
        name: value if name == "name" else rounded(value, 6)
        for name, value in vars(header.camera).items()
    }
    return {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "source": header.source,
        "smoothed": header.smoothed,
        "units": UNITS,
        "axes": AXES,
        "camera": camera | {"width": header.camera.width, "height": header.camera.height}
        if in_frames
        else None,
        "unit_mm": float(header.unit_mm),
        "skeleton": _skeleton_values(header.skeleton),
        **({"joint_format": joint_values.format_values(joints)} if joints else {}),
    }


def _skeleton_values(skeleton: Skeleton) -> dict[str, Any]:
    joints, (turning, sliding) = skeleton.joint_names, free_dofs(skeleton)
    parents = [joints[parent] if parent >= 0 else None for parent in skeleton.parents]
    angles = [
        {
            "name": skeleton.dof_names[d],
            "lower": _limit(skeleton.lower[d], skeleton.initial[d]),
            "upper": _limit(skeleton.upper[d], skeleton.initial[d]),
        }
        for d in turning
    ]
    return {
        "name": skeleton.name,
        "joints": joints,
        "parents": parents,
        "bones": [[parent, joint] for parent, joint in zip(parents, joints) if parent is not None],
        "angles": angles,
        "translations": [skeleton.dof_names[d] for d in sliding],
        "prototxt": text_of(skeleton.param, skeleton.name, ""),
    }


def header_of(fields: Fields) -> TrackHeader:
    """The header from its object. Raises DataError, PrototxtError."""
    if "format" not in fields or fields.text("format") != FORMAT:
        raise DataError(
            f"{fields.where}: not a track; expected a file that track --json has written"
        )
    if fields.whole("version") not in READABLE_VERSIONS:
        raise DataError(
            f"{fields.where}: format version {fields.whole('version')}; this program reads {FORMAT_VERSION}"
        )
    if not fields.has("camera"):
        raise DataError(
            f"{fields.where}: predicted from crops without a camera, so positions are relative to crops"
        )
    of, body = fields.part("camera"), fields.part("skeleton")
    camera = Camera(
        of.text("name"),
        of.positive("fx"),
        of.positive("fy"),
        of.number("u0"),
        of.number("v0"),
        of.whole("width"),
        of.whole("height"),
        of.number("min_range_mm", 0) if "min_range_mm" in of else MIN_RANGE_MM,
    )
    text = prototxt.parse(body.text("prototxt"), f"{body.where} 'prototxt'")
    skeleton = Skeleton(schema.read(text, SkeletonParameter, "a skeleton"))
    return TrackHeader(
        fields.text("source"),
        camera,
        skeleton,
        fields.positive("unit_mm"),
        fields.truth("smoothed"),
    )


# ------------------------------------------------------------------------------------------- frames


class FrameValues:
    """Frames as objects, in order: a hand's bones are in its first one, and where they change.

    live        write the bones in every frame, for receivers that miss some, and no raw positions:
                messages are short
    in_frames   False for hands in crops without their frames: positions are from the crop's centre,
                without a camera
    """

    def __init__(
        self,
        header: TrackHeader,
        joints: FormatName | None = None,
        gestures: bool = False,
        live: bool = False,
        in_frames: bool = True,
    ) -> None:
        self._skeleton, self._unit_mm = header.skeleton, header.unit_mm
        self._camera, self._joints = header.camera if in_frames else None, joints
        self._has_raw = header.smoothed and not live
        self._live = live
        self._gestures = GestureReader(header.skeleton) if gestures else None
        self._turning, self._sliding = free_dofs(header.skeleton)
        names = header.skeleton.dof_names
        self._angles, self._slides = (
            [names[d] for d in self._turning],
            [names[d] for d in self._sliding],
        )
        self._bones: dict[int, list[float] | None] = {}

    def values(self, frame: TrackedFrame) -> dict[str, Any]:
        """One frame as an object."""
        lost = [
            {"id": int(l.id), "hand": l.hand, "since_s": rounded(l.since, 6), "reason": l.reason}
            for l in frame.lost
        ]
        hands = [self._hand_values(hand, frame.time) for hand in frame.hands]
        hands += [
            {
                "id": int(one.id),
                "hand": one.hand,
                "presence": rounded(one.presence, 3),
                "confidence": rounded(one.confidence, 4),
                "palm_mm": rounded(one.place, 1),
                "positions_mm": None,
                **({"raw_positions_mm": None} if self._has_raw else {}),
                "reason": one.reason,
            }
            for one in frame.present
        ]
        hands.sort(key=lambda hand: int(hand["id"]))
        return {
            "number": int(frame.number),
            "time_s": rounded(frame.time, 6),
            "hands": hands,
            "lost": lost,
        }

    def _hand_values(self, hand: TrackedHand, time: float) -> dict[str, Any]:
        theta = self._skeleton.theta(hand.inputs)
        positions = hand.xyz.round(2)  # so that the palm is that of the positions in the file
        bones = _known(hand.bones * self._unit_mm, 3)
        same = not self._live and hand.id in self._bones and self._bones[hand.id] == bones
        self._bones[hand.id] = bones
        return {
            "id": int(hand.id),
            "hand": hand.known_side,
            **(
                {}
                if hand.known_side
                else {
                    "assumed_hand": hand.hand,
                    "assumed_confidence": rounded(hand.side_confidence, 3),
                }
            ),
            "presence": rounded(hand.presence, 3),
            "confidence": rounded(hand.confidence, 4),
            "error_mm": rounded(hand.error_mm, 2),
            "palm_mm": rounded(positions.mean(axis=0), 1),
            "finger_error_mm": dict(zip(FINGERS, rounded(hand.finger_error_mm, 1))),
            "positions_mm": rounded(positions, 2),
            **(
                {}
                if self._live or hand.raw_xyz is None
                else {"raw_positions_mm": rounded(hand.raw_xyz, 2)}
            ),
            "angles_rad": _named(self._angles, theta[self._turning], 5),
            "origin_mm": rounded(hand.origin_mm, 3),
            "translations_mm": _named(self._slides, theta[self._sliding] * self._unit_mm, 3),
            **({} if same else {"bones_mm": bones}),
            "crop": {"center_uvd": _known(hand.center_uvd, 3), "cube_mm": rounded(hand.cube_mm, 3)},
            **self._derived_values(hand, time),
        }

    def _derived_values(self, hand: TrackedHand, time: float) -> dict[str, Any]:
        """The joint format and the gesture, if requested."""
        found: dict[str, Any] = {}
        if self._joints is not None:
            found = joint_values.hand_values(self._joints, self._skeleton, hand, self._camera)
        if self._gestures is not None:
            seen = self._gestures.read(hand.id, hand.hand, hand.xyz, time)
            sure = rounded(seen.confidence, 3)
            found["gesture"] = {
                "name": seen.name or None,
                "number": seen.number,
                "confidence": sure,
            }
        return found

    def frame(self, fields: Fields) -> TrackedFrame:
        """The next frame from its object. Raises DataError."""
        every = list(fields.parts("hands"))
        hands = tuple(self._hand(hand) for hand in every if hand.has("positions_mm"))
        present = tuple(_present(hand) for hand in every if not hand.has("positions_mm"))
        lost = tuple(
            LostHand(
                of.whole("id"),
                of.one_of("hand", SIDES) if of.has("hand") else None,
                of.number("since_s"),
                of.text("reason"),
            )
            for of in fields.parts("lost")
        )
        return TrackedFrame(fields.whole("number"), fields.known("time_s"), hands, lost, present)

    def _hand(self, of: Fields) -> TrackedHand:
        assumed = not of.has("hand")
        crop, joints = of.part("crop"), len(self._skeleton.joint_names)
        theta = self._skeleton.initial.copy()
        theta[self._turning] = _by_name(of, "angles_rad", self._angles)
        theta[self._sliding] = _by_name(of, "translations_mm", self._slides) / self._unit_mm
        return TrackedHand(
            of.whole("id"),
            of.one_of("assumed_hand" if assumed else "hand", SIDES),
            of.known("confidence"),
            of.known("error_mm"),
            theta - self._skeleton.initial,
            self._bones_of(of),
            of.numbers("origin_mm", 3),
            of.numbers("positions_mm", joints, 3),
            crop.numbers("center_uvd", 3),
            crop.positive("cube_mm"),
            side_confidence=of.number("assumed_confidence", 0, 1 - 1e-6) if assumed else 1.0,
            finger_error_mm=_finger_errors(of),
            raw_xyz=of.numbers("raw_positions_mm", joints, 3) if "raw_positions_mm" in of else None,
            presence=of.known("presence") if "presence" in of else math.nan,
        )

    def _bones_of(self, of: Fields) -> Array:
        hand, joints = of.whole("id"), len(self._skeleton.joint_names)
        if "bones_mm" in of:
            known = of.has("bones_mm")
            self._bones[hand] = (
                of.numbers("bones_mm", joints).tolist() if known else [math.nan] * joints
            )
        if hand not in self._bones:
            raise DataError(f"{of.where}: hand {hand} has no 'bones_mm', neither here nor before")
        return np.array(self._bones[hand]) / self._unit_mm


def _named(names: list[str], numbers: Array, decimals: int) -> dict[str, float] | None:
    """Numbers by name; None if they are unknown."""
    return dict(zip(names, rounded(numbers, decimals))) if np.isfinite(numbers).all() else None


def _by_name(of: Fields, key: str, names: list[str]) -> Array:
    """The inverse of ``_named``, with NaN for unknown numbers. Raises DataError."""
    if not of.has(key):
        return np.full(len(names), np.nan)
    part = of.part(key)
    return np.array([part.number(name) for name in names])


def _finger_errors(of: Fields) -> Array:
    """The errors (5,) of the fingers; NaN if they are unknown, and in tracks of
    earlier programs.
    """
    if "finger_error_mm" not in of:
        return unknown_finger_errors()
    part = of.part("finger_error_mm")
    return np.array([part.known(finger) for finger in FINGERS])


def _present(of: Fields) -> PresentHand:
    x, y, z = of.numbers("palm_mm", 3).tolist()
    side = of.one_of("hand", SIDES) if of.has("hand") else None
    return PresentHand(
        of.whole("id"),
        side,
        of.known("presence"),
        of.known("confidence"),
        (x, y, z),
        of.text("reason"),
    )


# ------------------------------------------------------------------------------------------- angles

NO_LIMIT = 9999.0  # rad; the packaged hand stores 10000


def free_dofs(skeleton: Skeleton) -> tuple[list[int], list[int]]:
    """The DoFs that are free and move something: those that turn a joint, in rad; those that
    translate, in units.
    """
    turning = np.unique(skeleton.driven[skeleton.turns])
    return turning.tolist(), np.setdiff1d(skeleton.driven, turning).tolist()


def _limit(limit: float, initial: float) -> float | None:
    """A limit of an angle in rad, which is its input plus its initial value; None without one."""
    return float(limit) + float(initial) if abs(limit) < NO_LIMIT else None
