"""The data of a page as JSON values: a skeleton, cameras, named poses, and predicted hands with their depth.

skeleton  source (a name), text (the prototxt)
place     of the skeleton: unit_mm, camera, center_uvd (px, px, mm) and cube_mm of the crop
cameras   to choose from: name, fx, fy, u0, v0, width, height
poses     by name: inputs by DoF
bodies    others to choose from: name, skeleton and place as above
hands     to choose from, all of this skeleton, shown instead of it:
    name, words      of the frame; description of the hand
    place            as above
    inputs           of the whole body, including the DoFs of its surface; for a left hand those of its mirror image
    size, thickness  scale of bones, offsets and radii; of the radii alone
    side             "right" or "left"
    points, step_mm  16-bit numbers in base64, x y z of each point from the crop's centre, in units of step_mm
    crop             16-bit numbers in base64: the crop, -1 to 1 in steps of 1/32767
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.nyu import CUBE_MM
from handpose.body.sides import Side
from handpose.frames.cameras import CAMERAS, NYU, Camera
from handpose.frames.crops import SIZE, window
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.proto import schema

DISTANCE_MM = (
    700.0  # distance of a body without a frame, on the camera's axis; for other bodies in proportion to their size
)
FULL = 32767  # the largest 16-bit number

Poses = Mapping[str, Mapping[str, float]]


def content(
    skeleton: Skeleton, hands: Sequence[Mapping[str, Any]] = (), poses: Poses | None = None,
    unit_mm: float = CUBE_MM / 2,
) -> dict[str, Any]:
    """The data of a page for a skeleton, and, instead of it, the predicted hands."""
    source = Path(schema.position_of(skeleton.param).source).name  # without its folder, because pages are passed on
    middle = np.array([NYU.u0, NYU.v0, DISTANCE_MM * max(1.0, 2 * unit_mm / CUBE_MM)])
    return {
        "skeleton": {"source": source, "text": str(schema.to_tree(skeleton.param))},
        "place": _place(NYU, middle, 2 * unit_mm),
        "cameras": [vars(camera) for camera in CAMERAS.values()], "poses": dict(poses or {}), "hands": list(hands),
        "bodies": [],
    }


def body(name: str, skeleton: Skeleton, unit_mm: float = CUBE_MM / 2) -> dict[str, Any]:
    """Another body that a page offers."""
    made = content(skeleton, unit_mm=unit_mm)
    return {"name": name, "skeleton": made["skeleton"], "place": made["place"]}


def hand(
    name: str, words: str, inputs: ArrayLike, *, camera: Camera, center_uvd: Array,
    cube_mm: float, crop: NDArray[np.floating], size: float = 1.0, thickness: float = 1.0, side: Side = "right",
) -> dict[str, Any]:
    """A hand predicted in a crop (S, S) in [-1, 1], with the depth points of the crop.

    inputs  of the skeleton, or of the whole body; missing ones are 0
    """
    points = crop_points(crop, center_uvd, cube_mm, camera)
    step = max(float(np.abs(points).max(initial=0)), 1.0) / FULL
    given = np.asarray(inputs, dtype=np.float64)
    return {
        "name": name, "words": words,
        "place": _place(camera, center_uvd, cube_mm), "inputs": given.tolist(), "size": size, "thickness": thickness,
        "side": side, "points": _packed(points / step), "step_mm": step, "crop": _packed(crop * FULL),
    }


def crop_points(crop: NDArray[np.floating], center_uvd: ArrayLike, cube_mm: float, camera: Camera) -> Array:
    """The points of a crop (S, S) in [-1, 1] inside its cube, each image pixel once: (n, 3) mm from its centre."""
    uvd = np.asarray(center_uvd, dtype=np.float64)
    columns, rows = (pixels[0] for pixels in window(uvd[None], cube_mm, camera, SIZE))
    column, row = (np.unique(pixels, return_index=True)[1] for pixels in (columns, rows))
    column, row = column[columns[column] >= 0], row[rows[row] >= 0]
    i, j = np.meshgrid(column, row)
    value = crop[j, i].astype(np.float64)
    inside = np.abs(value) < 1
    seen = np.stack([columns[i], rows[j], value * cube_mm / 2 + uvd[2]], axis=-1)[inside]
    return np.asarray(camera.unproject(seen) - camera.unproject(uvd))


def _place(camera: Camera, center_uvd: ArrayLike, cube_mm: float) -> dict[str, Any]:
    middle = np.asarray(center_uvd, dtype=np.float64).tolist()
    return {"unit_mm": cube_mm / 2, "camera": vars(camera), "center_uvd": middle, "cube_mm": cube_mm}


def _packed(numbers: Array) -> str:
    return base64.b64encode(np.rint(numbers).astype("<i2").tobytes()).decode("ascii")
