"""Joints of another format and anatomical angles, as values of JSON and of a table.

In JSON a hand has the format's name as a key, and ``anatomical_deg``:

    mediapipe  landmarks        (x, y, z) of 21 in the image: x and y in [0, 1] of its width and
                                height, z behind the wrist in widths of the image
               world_landmarks  (x, y, z) in m about their mean: x right, y down, z away
               center_m         that mean, from the camera
    mano       positions_m      (x, y, z) of 21, from the camera: x right, y down, z away
    nyu        positions_mm     (x, y, z) of 14, from the camera: x right, y up, z away
    anatomical_deg              angles in degrees by name (``handpose.body.joint_formats.angles``)

A table has their numbers as columns: ``THUMB_TIP_x``, ``THUMB_TIP_world_x_m``, ``center_x_m``;
``index1_x_m``; ``palm_x_mm``; ``index_pip_flexion_deg``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from handpose.body.joint_formats.angles import ANGLES
from handpose.body.joint_formats.formats import FORMATS, FormatName, formatted
from handpose.frames.cameras import Camera
from handpose.tracking.track import HandPose
from netlib.blob import Array

DECIMALS = {"m": 5, "mm": 2}
ANGLES_KEY = "anatomical_deg"


def format_values(name: FormatName) -> dict[str, Any]:
    """A format, for the header of a track."""
    chosen = FORMATS[name]
    return {
        "name": name,
        "joints": list(chosen.joints),
        "bones": [list(bone) for bone in chosen.bones],
        "length": chosen.unit,
        "axes": chosen.in_words,
        "angles": list(ANGLES),
    }


def hand_values(name: FormatName, pose: HandPose, camera: Camera | None) -> dict[str, Any]:
    """The JSON values of a pose in a format. Raises DataError for another body than a hand."""
    angles = pose.angles
    digits = DECIMALS[FORMATS[name].unit]
    parts = _parts(name, pose, camera)
    joints = {
        key: None if values is None else _rounded(values, digits) for key, values in parts.items()
    }
    return {
        name: joints,
        ANGLES_KEY: {angle: _rounded(value, 2) for angle, value in angles.items()},
    }


def columns(name: FormatName) -> list[str]:
    """The columns of a table, as ``numbers`` has their values."""
    joints = list(FORMATS[name].joints)
    unit = FORMATS[name].unit
    if name == "mediapipe":
        found = [f"{joint}_{axis}" for joint in joints for axis in "xyz"]
        found += [f"{joint}_world_{axis}_m" for joint in joints for axis in "xyz"]
        found += [f"center_{axis}_m" for axis in "xyz"]
    else:
        found = [f"{joint}_{axis}_{unit}" for joint in joints for axis in "xyz"]
    return found + [f"{angle}_deg" for angle in ANGLES]


def numbers(name: FormatName, pose: HandPose, camera: Camera | None) -> list[str]:
    """The values of a row, one for each column. Raises DataError for another body than a hand."""
    texts = []
    angles = [f"{angle:.2f}" for angle in pose.angles.values()]
    digits = DECIMALS[FORMATS[name].unit]
    for values in _parts(name, pose, camera).values():
        if values is not None:
            texts += [f"{number:.{digits}f}" for number in values.ravel().tolist()]
        else:  # landmarks, where the size of the image is unknown
            texts += [""] * (3 * len(FORMATS[name].joints))
    return texts + angles


def _parts(name: FormatName, pose: HandPose, camera: Camera | None) -> dict[str, Array | None]:
    """The arrays of a pose in a format by their keys in JSON; without a camera,
    those of its crop.
    """
    cube_mm = pose.cube_mm if camera is None else None
    found = formatted(name, pose.skeleton, pose.side, pose.xyz, camera, cube_mm)
    if name != "mediapipe":
        return {f"positions_{FORMATS[name].unit}": found.positions}
    center = found.positions.mean(axis=0)
    return {
        "landmarks": found.landmarks,
        "world_landmarks": found.positions - center,
        "center_m": center,
    }


def _rounded(values: Any, digits: int) -> Any:
    return (np.asarray(values, np.float64).round(digits) + 0.0).tolist()
