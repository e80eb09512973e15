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

import itertools
from typing import Any

import numpy as np

from handpose.body.joint_formats.angles import ANGLES
from handpose.body.joint_formats.formats import FORMATS, FormatName, formatted
from handpose.frames.cameras import Camera
from handpose.output.tracks.plain_numbers import fields_of, rounded, rounded_if_known
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
    digits = DECIMALS[FORMATS[name].unit]
    parts = _parts(name, pose, camera)
    joints = {key: rounded_if_known(values, digits) for key, values in parts.items()}
    angles = dict(zip(pose.angles, rounded([*pose.angles.values()], 2)))
    return {name: joints, ANGLES_KEY: angles}


def columns(name: FormatName) -> list[str]:
    """The columns of a table, as ``numbers`` has their values."""
    joints = FORMATS[name].joints
    points = [f"{joint}_%s_{FORMATS[name].unit}" for joint in joints]
    if name == "mediapipe":
        world = [f"{joint}_world_%s_m" for joint in joints]
        points = [*(f"{joint}_%s" for joint in joints), *world, "center_%s_m"]
    found = [point % axis for point in points for axis in "xyz"]
    return found + [f"{angle}_deg" for angle in ANGLES]


def numbers(name: FormatName, pose: HandPose, camera: Camera | None) -> list[str]:
    """The values of a row, one for each column. Raises DataError for another body than a hand."""
    angles = fields_of([*pose.angles.values()], 2)
    digits = DECIMALS[FORMATS[name].unit]
    parts = [fields_of(values, digits) for values in _parts(name, pose, camera).values()]
    return [*itertools.chain(*parts), *angles]


def _parts(name: FormatName, pose: HandPose, camera: Camera | None) -> dict[str, Array]:
    """The arrays of a pose in a format by their keys in JSON; without a camera,
    those of its crop. Landmarks are NaN where the size of the image is unknown.
    """
    cube_mm = pose.cube_mm if camera is None else None
    found = formatted(name, pose.skeleton, pose.side, pose.xyz, camera, cube_mm)
    if name != "mediapipe":
        return {f"positions_{FORMATS[name].unit}": found.positions}
    center = found.positions.mean(axis=0)
    world = found.positions - center
    landmarks = np.full_like(world, np.nan) if found.landmarks is None else found.landmarks
    return {"landmarks": landmarks, "world_landmarks": world, "center_m": center}
