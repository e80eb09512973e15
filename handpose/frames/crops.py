"""The network's input: the cube around the hand, cut from a depth image and scaled to [-1, 1].

A cube of ``cube_mm`` with its middle at the centre (u, v, d) covers the pixels

    floor((u d / f - cube / 2) / d f)  <=  column  <  floor((u d / f + cube / 2) / d f)
                                           likewise rows

which are resized to ``size`` x ``size`` keeping the aspect, by nearest neighbour, because the mean
of two depths at an edge would be a point in empty space. Depths outside the cube are clipped to its
faces. Pixels without a reading, and those outside the image, become background, the far face:

    value = (depth - d) / (cube / 2)  in [-1, 1],    background 1

This is the preprocessing of the paper's released system, to the pixel. Because of the nearest
neighbour, a crop is a selection of pixels, ``Window``, and the renderer casts rays through
these pixels only.

``clear_crop`` also removes flying pixels: at an edge, a depth camera mixes the depths of both sides
into one that belongs to neither. With a time-of-flight camera, half of the pixels along the outline
of a hand lie 14 mm or more behind it, a quarter 40 mm (320 x 240 pixels, 400 mm away). It also
removes what is in front of the cube and does not continue a surface in it, such as a reflection. An
arm that reaches through the near face does, and stays.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.frames.cameras import NYU, Camera, Floats
from netlib.blob import Array
from netlib.errors import DataError

SIZE = 128  # pixels on a side
# range of a cube's edge: a small hand to several people; values in metres are below it
CUBES_MM = (50.0, 10_000.0)

BACKGROUND = 1.0  # the value of the far face
FAR_FACE = 0.999  # values from it on are background, including rounding
STEP_MM = 8.0  # minimum depth step between two surfaces
STEP_PX = 5.0  # minimum step in pixel widths, for wide pixels: a slope of 79 degrees
NEAR_FACE = -0.999  # values below it are readings in front of the cube
REACHING_MM = 25.0  # a surface this close to the near face may continue in front of it
# pixels of contact: at least; relative to the square root of a component's area
MIN_CONTACT_PX, MIN_CONTACT = 3, 0.1
_AROUND = np.ones((3, 3), np.uint8)
T = TypeVar("T", bound=np.generic)


class Window(NamedTuple):
    """The image pixels of N crops."""

    columns: NDArray[np.int64]  # (N, size) image column of each crop column, -1 outside the image
    rows: NDArray[np.int64]  # (N, size) image row of each crop row, -1 outside the image


class _Span(NamedTuple):
    """The image pixels and the crop pixels of N crops, along one axis."""

    start: Array  # (N,) first image pixel
    extent: Array  # (N,) number of image pixels
    pad: Array  # (N,) first crop pixel
    length: Array  # (N,) number of crop pixels


def window(
    center_uvd: ArrayLike, cube_mm: ArrayLike, camera: Camera = NYU, size: int = SIZE
) -> Window:
    """The window of each centre (N, 3), px, px, mm, with cubes of edge ``cube_mm``, one or (N,).

    Raises DataError.
    """
    chosen = []
    for span, pixels in zip(
        _spans(center_uvd, cube_mm, camera, size), (camera.width, camera.height), strict=True
    ):
        start, extent, pad, length = (value[:, None] for value in span)
        i = np.arange(size) - pad  # crop pixel -> resized window, (N, size)
        # in OpenCV's order of operations, and so its rounding
        source = np.floor(i * (1.0 / (length / extent)))
        index = start + np.minimum(source, extent - 1)
        inside = (i >= 0) & (i < length) & (index >= 0) & (index < pixels)
        chosen.append(np.where(inside, index, -1).astype(np.int64))
    return Window(chosen[0], chosen[1])


def crop_pixels(
    uvd: ArrayLike,
    center_uvd: ArrayLike,
    cube_mm: ArrayLike,
    camera: Camera = NYU,
    size: int = SIZE,
) -> Array:
    """Column and row (N, K, 2) of image points (N, K, 3) in the crops at the centres (N, 3)."""
    first, factor = (each[:, None] for each in crop_scale(center_uvd, cube_mm, camera, size))
    return first + factor * np.asarray(uvd, dtype=np.float64)[..., :2] + 0.5


def crop_scale(
    center_uvd: ArrayLike, cube_mm: ArrayLike, camera: Camera = NYU, size: int = SIZE
) -> tuple[Array, Array]:
    """Offset and factor, (N, 2) each for columns and rows: crop
    pixel = offset + factor * image pixel.

    Middles are mapped to middles, as in an area resize. ``window`` picks pixels by their first
    edges, as OpenCV's nearest neighbour does: on average it shows an image pixel half a crop pixel
    later, as ``crop_pixels`` does.
    """
    spans = _spans(center_uvd, cube_mm, camera, size)
    factor = np.stack([span.length / span.extent for span in spans], axis=1)
    first = [(0.5 - span.start) * span.length / span.extent + span.pad - 0.5 for span in spans]
    return np.stack(first, axis=1), factor


def _spans(
    center_uvd: ArrayLike, cube_mm: ArrayLike, camera: Camera, size: int
) -> tuple[_Span, _Span]:
    center = np.atleast_2d(np.asarray(center_uvd, dtype=np.float64))
    cube = np.broadcast_to(np.asarray(cube_mm, dtype=np.float64), len(center))
    is_place = np.isfinite(center).all(axis=1) & (center[:, 2] > 0)
    good = is_place & np.isfinite(cube) & (cube > 0)
    if not good.all():
        bad = int(np.argmin(good))
        u, v, d = center[bad]
        raise DataError(
            f"crop {bad}: centre u {u:g} px, v {v:g} px, depth {d:g} mm with a cube of {cube[bad]:g} mm; "
            "expected finite numbers, depth and cube above 0"
        )
    d = center[:, 2]
    half = cube / 2
    edges = []
    for at, f in ((center[:, 0], camera.fx), (center[:, 1], camera.fy)):
        at_mm = at * d / f
        edges.append((np.floor((at_mm - half) / d * f), np.floor((at_mm + half) / d * f)))
    longest = np.maximum(*(np.maximum(stop - start, 1) for start, stop in edges))
    spans = []
    for start, stop in edges:
        extent = np.maximum(stop - start, 1)  # a cube very far away is one pixel
        length = np.maximum(extent * size // longest, 1)
        spans.append(_Span(start, extent, size // 2 - length // 2, length))
    return spans[0], spans[1]


def numbers(values: object, what: str, masked: float) -> NDArray[Any]:
    """An array of numbers, with ``masked`` in place of masked values.

    Raises DataError; ``what`` begins its message.
    """
    if not isinstance(values, np.ndarray):
        raise DataError(f"{what} is a {type(values).__name__}, expected an array of numbers")
    if values.dtype.kind not in "fiub":
        raise DataError(f"{what} is an array of {values.dtype}, expected numbers")
    return values.filled(masked) if isinstance(values, np.ma.MaskedArray) else values


def check_size(depth: NDArray[np.generic], camera: Camera) -> None:
    """Raise DataError for a depth image of another size than the camera's."""
    if depth.shape != (camera.height, camera.width):
        raise DataError(
            f"depth image of shape {depth.shape}, expected {(camera.height, camera.width)} of camera {camera.name!r}"
        )


def crop(
    depth: NDArray[np.generic],
    center_uvd: ArrayLike,
    cube_mm: float,
    camera: Camera = NYU,
    size: int = SIZE,
) -> Floats:
    """The crop (size, size) float32 in [-1, 1] of a depth image in mm. Raises DataError.

    depth       (camera.height, camera.width), 0 where there is no reading
    center_uvd  (3,) middle of the cube: pixels and mm
    cube_mm     edge of the cube
    """
    depth = numbers(depth, "depth image", 0)
    check_size(depth, camera)
    columns, rows = (
        index[0] for index in window(np.reshape(center_uvd, (1, 3)), cube_mm, camera, size)
    )
    u, v, d = np.asarray(center_uvd, dtype=np.float64)
    if (columns < 0).all() or (rows < 0).all():
        raise DataError(
            f"the cube of {cube_mm:g} mm at u {u:g}, v {v:g}, {d:g} mm lies outside the image"
        )
    half = cube_mm / 2
    out = depth[rows[:, None], columns].astype(np.float64)
    # False for NaN, which some drivers write
    read = (columns >= 0) & (rows >= 0)[:, None] & (out > 0)
    np.copyto(out, d + half, where=~read)
    np.clip(out, d - half, d + half, out=out)
    out -= d
    out /= half
    return out.astype(np.float32)


def normalise_joints(xyz: ArrayLike, center_xyz: ArrayLike, half_cube: ArrayLike) -> Array:
    """Joints (N, K, 3) in mm, camera axes, to half-cubes from the centre (N, 3); ``half_cube``
    mm, one or (N,).
    """
    center, half = _each(center_xyz, half_cube)
    return (np.asarray(xyz, dtype=np.float64) - center) / half


def restore_joints(joints: ArrayLike, center_xyz: ArrayLike, half_cube: ArrayLike) -> Array:
    """The inverse of ``normalise_joints``: half-cubes to mm in camera axes."""
    center, half = _each(center_xyz, half_cube)
    return np.asarray(joints, dtype=np.float64) * half + center


def _each(center_xyz: ArrayLike, half_cube: ArrayLike) -> tuple[Array, Array]:
    """The centre and the half-cube of each joint."""
    return np.asarray(center_xyz)[..., None, :], np.asarray(half_cube)[..., None, None]


def clear_crop(
    depth: NDArray[np.generic], center_uvd: ArrayLike, cube_mm: float, camera: Camera
) -> Floats:
    """``crop`` of a depth image, in which flying pixels and isolated near ones are background.

    Raises DataError.
    """
    d = float(np.asarray(center_uvd, dtype=np.float64)[2])
    half = cube_mm / 2
    clean = without_flying_pixels(crop(depth, center_uvd, cube_mm, camera), half, d / camera.fx)
    return without_isolated_near(clean, half)


def with_hidden(
    crop_of_hand: Floats,
    readings: NDArray[np.generic],
    center_uvd: ArrayLike,
    cube_mm: float,
    camera: Camera,
) -> Floats:
    """A crop (S, S) whose pixels with a reading in front of the cube are at the near face, even
    isolated ones.

    What is behind them is unknown: the hand may continue there.

    readings    (height, width) mm, with the readings that are nearer than the camera measures
    center_uvd  (3,) middle of the cube, of edge ``cube_mm``
    """
    hidden = crop(readings, center_uvd, cube_mm, camera, len(crop_of_hand)) <= NEAR_FACE
    return np.where(hidden, np.float32(-1), crop_of_hand) if hidden.any() else crop_of_hand


def unread(
    readings: NDArray[np.generic], center_uvd: ArrayLike, cube_mm: float, camera: Camera
) -> NDArray[np.bool_]:
    """True (S, S) for the pixels of a crop that are in the image and have no reading;
    arguments as ``crop``.
    """
    is_unread = ~(readings > 0)  # type: ignore[operator]
    return picked(is_unread, center_uvd, cube_mm, camera)


def picked(image: NDArray[T], center_uvd: ArrayLike, cube_mm: float, camera: Camera) -> NDArray[T]:
    """The pixels (S, S) of an image that a crop shows, 0 outside the image; arguments as
    ``crop``.
    """
    columns, rows = (index[0] for index in window(np.reshape(center_uvd, (1, 3)), cube_mm, camera))
    is_inside = (columns >= 0) & (rows >= 0)[:, None]
    return np.where(is_inside, image[rows[:, None], columns], image.dtype.type(0))


def without_flying_pixels(crop: Floats, half_mm: float, pixel_mm: float) -> Floats:
    """A crop (S, S) in [-1, 1] in which flying pixels are background.

    half_mm   half the edge of the cube
    pixel_mm  width of a pixel of the camera's image, at the crop's depth
    """
    step = np.float32(max(STEP_MM, STEP_PX * pixel_mm) / half_mm)
    behind = crop - cv2.erode(crop, _AROUND) > step
    behind &= crop < BACKGROUND
    if not behind.any():
        return crop
    surface = (crop < BACKGROUND) & ~behind
    nearest = cv2.erode(np.where(surface, crop, np.float32(9)), _AROUND)
    farthest = cv2.dilate(np.where(surface, crop, np.float32(-9)), _AROUND)
    out = crop.copy()
    # A pixel between two surfaces belongs to the far one if it is close to it.
    is_between = (np.abs(farthest - crop) > step) & (np.abs(nearest - crop) > step)
    out[behind & is_between] = BACKGROUND
    return out


def without_isolated_near(crop: Floats, half_mm: float) -> Floats:
    """A crop (S, S) in [-1, 1] in which readings in front of the cube that continue no surface
    are background.

    half_mm  half the edge of the cube
    """
    near = crop <= NEAR_FACE
    if not near.any():
        return crop
    count, component = cv2.connectedComponents(
        cv2.dilate(near.astype(np.uint8), _AROUND), connectivity=8
    )
    reaching = ~near & (crop < REACHING_MM / half_mm - 1)
    contact = np.bincount(component[reaching], minlength=count)
    area = np.bincount(component[near], minlength=count)
    continues = contact >= np.maximum(MIN_CONTACT_PX, MIN_CONTACT * np.sqrt(area))
    out = crop.copy()
    out[near & ~continues[component]] = BACKGROUND
    return out
