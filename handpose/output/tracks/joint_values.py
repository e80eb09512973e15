"""Joints of another format and anatomical angles, as values of JSON and of a table.

In JSON a hand has the format's name as a key, and ``anatomical_deg``:

    mediapipe  landmarks        (x, y, z) of 21 in the image: x and y in [0, 1] of its width and height, z behind the
                                wrist in widths of the image
               world_landmarks  (x, y, z) in m about their mean: x right, y down, z away
               center_m         that mean, from the camera
    mano       positions_m      (x, y, z) of 21, from the camera: x right, y down, z away
    nyu        positions_mm     (x, y, z) of 14, from the camera: x right, y up, z away
    anatomical_deg              angles in degrees by name (``handpose.body.joint_formats.formats``)

A table has their numbers as columns: ``THUMB_TIP_x``, ``THUMB_TIP_world_x_m``, ``center_x_m``; ``index1_x_m``;
``palm_x_mm``; ``index_pip_flexion_deg``.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from handpose.body.joint_formats.formats import ANGLES, FORMATS, FormatName, FormattedHand, angles_of, formatted
from handpose.body.joint_formats.frames import HandFrames, hand_frames
from handpose.body.sides import Side
from handpose.frames.cameras import Camera
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

DECIMALS = {"m": 5, "mm": 2, "landmarks": 5, "deg": 2}
ANGLES_KEY = "anatomical_deg"


def format_values(name: FormatName) -> dict[str, Any]:
    """A format, for the header of a track."""
    chosen = FORMATS[name]
    return {"name": name, "joints": list(chosen.joints), "bones": [list(bone) for bone in chosen.bones],
            "length": chosen.unit, "axes": chosen.in_words, "angles": list(ANGLES)}


def hand_values(
    name: FormatName, skeleton: Skeleton, hand: Side, xyz: Array, camera: Camera | None, cube_mm: float | None = None,
    frames: HandFrames | None = None,
) -> dict[str, Any]:
    """The JSON values of a hand in a format. Raises DataError for another body than a hand.

    frames  the hand's directions, if they are computed already (``hand_frames``)
    """
    frames = frames or hand_frames(skeleton, hand, xyz)
    parts, angles = _parts(formatted(name, skeleton, hand, xyz, camera, cube_mm)), angles_of(frames)
    joints = {key: None if values is None else _rounded(values, key) for key, values in parts.items()}
    return {name: joints, ANGLES_KEY: {angle: _rounded(value, "deg") for angle, value in angles.items()}}


def columns(name: FormatName) -> list[str]:
    """The columns of a table, as ``numbers`` has their values."""
    joints, unit = list(FORMATS[name].joints), FORMATS[name].unit
    if name == "mediapipe":
        found = [f"{joint}_{axis}" for joint in joints for axis in "xyz"]
        found += [f"{joint}_world_{axis}_m" for joint in joints for axis in "xyz"]
        found += [f"center_{axis}_m" for axis in "xyz"]
    else:
        found = [f"{joint}_{axis}_{unit}" for joint in joints for axis in "xyz"]
    return found + [f"{angle}_deg" for angle in ANGLES]


def numbers(
    name: FormatName, skeleton: Skeleton, hand: Side, xyz: Array, camera: Camera | None, frames: HandFrames,
    cube_mm: float | None = None,
) -> list[str]:
    """The values of a row, one for each column; ``frames`` are the hand's directions."""
    parts = _parts(formatted(name, skeleton, hand, xyz, camera, cube_mm))
    return list(itertools.chain(_texts(parts), _texts({"deg": list(angles_of(frames).values())})))


def _texts(parts: dict[str, Any]) -> Iterator[str]:
    for key, values in parts.items():
        if values is not None:
            yield from (f"%.{_decimals(key)}f" % number for number in np.ravel(values))
        else:  # landmarks, where the size of the image is unknown
            yield from [""] * (3 * len(FORMATS["mediapipe"].joints))


def _parts(found: FormattedHand) -> dict[str, Array | None]:
    if found.format.name == "mediapipe":
        return {"landmarks": found.landmarks, "world_landmarks": found.world_landmarks, "center_m": found.center}
    return {f"positions_{found.format.unit}": found.positions}


def _decimals(key: str) -> int:
    return DECIMALS.get(key) or DECIMALS[key.rpartition("_")[2] if key != "world_landmarks" else "m"]


def _rounded(values: Any, key: str) -> Any:
    return (np.asarray(values, np.float64).round(_decimals(key)) + 0.0).tolist()
