"""Inspection of a recording: its metadata, statistics of its first frames, and warnings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import MIN_RANGE_MM, UNIT_MM, Camera
from handpose.frames.recording import MAX_UINT16, DepthFrame, Recording
from netlib.errors import DataError

MAX_INSPECTED_FRAMES = 10  # number of inspected frames
NEAREST_SHARE = 0.5  # percentile of the depths that counts as nearest; fewer pixels are noise
# depth range of the nearest object, relative to its distance, which is independent of the unit
BEHIND = 1.25
MAX_NEAR_SHARE = 1e-3  # share of the readings that may be nearer than the camera measures
FARTHEST_HAND_MM = 1600.0  # hands beyond it are not found
NEAREST_HAND_MM = 120.0  # a hand is farther away in all depth cameras
NARROW_MM, WIDE_MM = 25.0, 1500.0  # range of widths: a hand, or a hand with arm and shoulder
USUAL_MM = (300.0, 1200.0)  # range of distances of a hand
# distance and width beyond which the nearest object is a person, or a hand of another unit
BODY_MM = (1000.0, 500.0)
SMALL_MM = 250.0  # width of a hand at most; a wider object may be a hand of another unit
HAND_MM = (40.0, 600.0)  # range of widths of a hand with its forearm
# mm, of existing cameras and files, the most likely first
POSSIBLE_UNITS_MM = (1.0, 0.125, 0.25, 0.1, 0.2, 0.5, 1000.0, 10.0)
VIEW_DEGREES = (20.0, 130.0)
FASTEST_S, SLOWEST_S = 0.002, 1.0  # plausible times from one frame to the next
OFF_RATE = 3.0  # maximum ratio of the rate that is given to that of the times
# of a Kinect 1: the stored value without a reading of its disparities, and the minimum share of it
DISPARITY_UNREAD, MIN_UNREAD_SHARE = 2047, 0.01
MAX_BYTE = 255
# Of exchanged bytes: minimum share of neighbours that differ much, and its minimum ratio to that
# after another exchange. In 102 takes (eight real recordings, and synthetic ones of three cameras
# in units of 1 and 1/8 mm) the share is at most 0.011, and 0.42 or more with exchanged bytes; the
# ratio at most 0.02, and 53 or more.
MIN_JUMPS, SWAPPED = 0.01, 4
TURNED = 0.1  # a principal point is farther from the middle of turned frames
SAME_TIMES = 1.1  # maximum ratio of two factors that count as the same
OFF_MIDDLE = 0.2  # maximum distance of a principal point from the middle, as a share of the size


@dataclass(frozen=True)
class Inspection:
    """The result of an inspection.

    recording
    remarks   of the recording before any other frame is read
    frames    the first ones, which were inspected
    rest      those after them; of a live camera none
    depth_mm  the 1st, 50th and 99th percentile of the depths; None without a reading
    zeros     share of pixels without a reading
    nearest   distance and width in mm of the nearest object, None without one
    warnings  likely errors and what to do about them, one line each
    doubt     why the unit may be wrong if no hand is found, else empty
    """

    recording: Recording
    remarks: tuple[str, ...]
    frames: tuple[DepthFrame, ...]
    rest: Iterator[DepthFrame]
    depth_mm: tuple[float, float, float] | None
    zeros: float
    nearest: tuple[float, float] | None
    warnings: tuple[str, ...]
    doubt: str

    def all_frames(self) -> Iterator[DepthFrame]:
        """The frames of the recording, once, without reading the first ones again; new
        ones of a camera.
        """
        return iter(self.recording) if self.recording.live else chain(self.frames, self.rest)


def inspect(recording: Recording) -> Inspection:
    """Inspect the first frames of a recording. Raises DataError if none can be read."""
    iterator = iter(recording)
    seen = tuple(islice(iterator, MAX_INSPECTED_FRAMES))
    if not seen:
        raise DataError(f"{recording.name}: no frame in it{recording.cut and f': {recording.cut}'}")
    shown = checked([frame.depth for frame in seen], recording.camera, recording.unit_mm)
    depth_mm = None
    of_times = _of_times(np.array([frame.time for frame in seen]), recording.rate)
    warnings = [*recording.warnings, *shown.of_camera, *shown.of_depths, *of_times]
    if len(shown.readings):
        low, middle, high = np.percentile(shown.readings, (1, 50, 99)).tolist()
        depth_mm = (low, middle, high)
    else:
        warnings.append(
            f"no depth in the first {len(seen)} frames: every depth is 0; is the camera covered, or the "
            "hand too near?"
        )
    pixels = sum(frame.depth.size for frame in seen)
    return Inspection(
        recording=recording,
        remarks=recording.remarks,
        frames=seen,
        rest=iter(()) if recording.live else iterator,
        depth_mm=depth_mm,
        zeros=1 - len(shown.readings) / pixels,
        nearest=shown.nearest,
        warnings=tuple(warnings),
        doubt=shown.doubt,
    )


class Checked(NamedTuple):
    """What frames show, and what is likely wrong with their parameters, one line each.

    readings   (N,) mm, of all frames
    nearest    distance and width in mm of the nearest object, None without a reading
    of_camera  warnings about its focal lengths and its principal point
    of_depths  about the unit and the range of the depths
    doubt      why the unit may be wrong if no hand is found, else empty
    """

    readings: NDArray[np.float32]
    nearest: tuple[float, float] | None
    of_camera: tuple[str, ...]
    of_depths: tuple[str, ...]
    doubt: str


def checked(
    frames: Sequence[NDArray[np.float32]], camera: Camera, unit_mm: float | None = None
) -> Checked:
    """Check frames (height, width) in mm, one or more, and their parameters; the default unit
    is the camera's.
    """
    readings = np.concatenate([depth[depth > 0] for depth in frames])
    nearest = next(
        (found for depth in frames if (found := nearest_thing(depth, camera)) is not None), None
    )
    if nearest is None:
        return Checked(readings, None, tuple(_of_camera(camera)), (), "")
    unit_mm = unit_mm or UNIT_MM.get(camera.name, 1.0)
    warning, doubt = _of_unit(nearest, unit_mm)
    if _are_disparities(readings / unit_mm):
        warning = (
            f"no value is more than {DISPARITY_UNREAD}, which many pixels have: these are likely "
            "disparities of a Kinect 1, no depths; record depth in mm (libfreenect: FREENECT_DEPTH_MM)"
        )
    if _are_swapped(frames, unit_mm):
        doubt = ""
        warning = (
            "neighbouring pixels are much more alike with the two bytes of each value exchanged: these "
            "are likely depths of the other byte order; write image.byteswap()"
        )
    share = float(np.mean(readings < camera.min_range_mm))
    if not warning and share > MAX_NEAR_SHARE:
        warning = (
            f"{share:.1%} of the readings are nearer than {camera.min_range_mm:g} mm, the minimum range of the "
            "camera, and count as missing; if it measures them, give min_range_mm in camera.json"
        )
    return Checked(
        readings, nearest, tuple(_of_camera(camera)), (warning,) if warning else (), doubt
    )


def _are_disparities(values: NDArray[Any]) -> bool:
    """Whether stored values (N,) are likely the 11-bit disparities of a Kinect 1."""
    unread = np.rint(values) == DISPARITY_UNREAD
    return values.max() < DISPARITY_UNREAD + 0.5 and float(np.mean(unread)) > MIN_UNREAD_SHARE


def _are_swapped(frames: Sequence[NDArray[np.float32]], unit_mm: float) -> bool:
    """Whether frames likely have the two bytes of their stored values exchanged: then many
    neighbours differ in the high byte, and few if the bytes are exchanged again.
    """
    values = np.rint(np.stack(frames) / unit_mm)
    if values.max() > MAX_UINT16:
        return False
    whole = values.astype(np.uint16)
    whole[whole == MAX_UINT16] = 0  # of some cameras, no reading
    jumps = _jumps(whole)
    return jumps > MIN_JUMPS and jumps > SWAPPED * _jumps(whole.byteswap())


def _jumps(values: NDArray[np.uint16]) -> float:
    """The share of the neighbouring readings that differ by a high byte or more."""
    seen = values > 0
    both = seen[..., 1:] & seen[..., :-1]
    steps = np.abs(np.diff(values.astype(np.int32)))
    large = steps[both] > MAX_BYTE
    return float(np.mean(large)) if large.size else 0.0


def nearest_thing(depth: NDArray[np.float32], camera: Camera) -> tuple[float, float] | None:
    """Distance and width in mm of the nearest object in a frame, None without a reading.

    The object does not depend on the unit: it is everything connected, up to a quarter farther away
    than its front. Readings nearer than the camera measures count only if there are no others; then
    the unit may be wrong.
    """
    seen = depth > 0
    near = camera.is_too_near(depth)
    if (seen & ~near).any():
        seen &= ~near
    if not seen.any():
        return None
    front = float(np.percentile(depth[seen], NEAREST_SHARE))
    slab = (seen & (depth <= front * BEHIND)).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(slab, connectivity=8)
    one = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    distance = float(np.median(depth[one]))
    left, right = np.percentile(np.nonzero(one)[1], (2, 98))
    return distance, float((right - left + 1) * distance / camera.fx)


def view_of(camera: Camera) -> tuple[float, float]:
    """The angles of view in degrees, horizontal and vertical."""
    return _angle(camera.width, camera.u0, camera.fx), _angle(camera.height, camera.v0, camera.fy)


def _angle(size: int, middle: float, focal: float) -> float:
    """The angle of view in degrees along one axis."""
    return math.degrees(math.atan2(middle + 0.5, focal) + math.atan2(size - 0.5 - middle, focal))


def _of_camera(camera: Camera) -> Iterator[str]:
    view = view_of(camera)
    size = f"{camera.width} x {camera.height}"
    if not all(VIEW_DEGREES[0] <= angle <= VIEW_DEGREES[1] for angle in view):
        yield (
            f"focal lengths of {camera.fx:g}, {camera.fy:g} px give a field of view of {view[0]:.0f} x "
            f"{view[1]:.0f} degrees in {size} pixels; check fx and fy, which may be for another image "
            "size"
        )
    ways = ((camera.u0, camera.width), (camera.v0, camera.height))
    if _is_turned(camera):
        yield (
            f"the principal point {camera.u0:g}, {camera.v0:g} is that of {camera.height} x {camera.width} pixels, "
            f"and these are {size}: transpose arrays (width, height), whose hands are mirrored; of frames "
            "that were turned, turn fx, fy, u0 and v0, too"
        )
    elif any(abs(middle - size / 2) > OFF_MIDDLE * size for middle, size in ways):
        where = (
            "far from the centre" if all(0 <= middle < size for middle, size in ways) else "outside"
        )
        times = [2 * middle / size for middle, size in ways]
        is_scaled = 0 < max(times) < SAME_TIMES * min(times)
        scale = f", about {sum(times) / 2:.2g} times as wide: divide all four" if is_scaled else ""
        yield (
            f"the principal point {camera.u0:g}, {camera.v0:g} is {where} of {size} pixels; check u0 and v0, "
            f"which may be for another image size{scale}"
        )


def _is_turned(camera: Camera) -> bool:
    """Whether the principal point is near the middle of frames of exchanged width and
    height alone.
    """
    middle, size = np.array([camera.u0, camera.v0]), np.array([camera.width, camera.height])
    here, turned = (np.abs(middle / full - 0.5) for full in (size, size[::-1]))
    return bool(turned.max() < TURNED < here.min())


def _of_times(times: NDArray[np.float64], rate: float | None) -> Iterator[str]:
    """A warning if times (N,) in s are likely of another unit or do not agree with the rate."""
    if len(times) < 2:
        return
    step = float(np.median(np.diff(times)))
    if not FASTEST_S <= step <= SLOWEST_S:
        yield f"a frame every {step:.3g} s, which is not plausible; check the times (--time-unit, --rate)"
    elif rate and not 1 / OFF_RATE <= step * rate <= OFF_RATE:
        yield f"a frame every {step:.3g} s by the times, which are used, and not {rate:g} frames/s"


def _of_unit(nearest: tuple[float, float], unit_mm: float) -> tuple[str, str]:
    """A warning if the nearest object cannot be a hand, and a doubt if it may be one in another
    unit; else empty.
    """
    distance, width = nearest
    seen = f"the nearest object is {_length(distance)} away and {_length(width)} wide"
    others = _in_other_units(distance, width, unit_mm)
    warning = doubt = ""
    is_near = distance < NEAREST_HAND_MM or not NARROW_MM <= width <= WIDE_MM
    is_body = distance > BODY_MM[0] and width > BODY_MM[1]
    if is_near or is_body or distance > FARTHEST_HAND_MM:
        advice = f"{others}; " if others else ""
        warning = f"{seen}, which is not plausible for a hand: {advice}check the unit, here {unit_mm:g} mm"
    is_usual = MIN_RANGE_MM <= distance <= BODY_MM[0] and width <= SMALL_MM
    if others and not is_usual:
        doubt = f"the unit, {unit_mm:g} mm, may be wrong: {seen}, {others}"
    return warning, doubt


def _in_other_units(distance: float, width: float, unit_mm: float) -> str:
    """The units in which an object would be a hand, in words; empty without any."""
    found: list[str] = []
    for unit in POSSIBLE_UNITS_MM:
        factor = unit / unit_mm
        away, wide = distance * factor, width * factor
        is_hand = USUAL_MM[0] <= away <= USUAL_MM[1] and HAND_MM[0] <= wide <= HAND_MM[1]
        if is_hand and unit != unit_mm:
            verb = "" if found else " it would be"
            size = f"{away / 1000:.2f} m away and {_length(wide)} wide"
            found.append(f"with --unit {unit:g}{verb} {size}")
    return ", ".join(found)


def _length(mm: float) -> str:
    return f"{mm / 1000:.3g} m" if mm >= 1000 else f"{mm:.3g} mm"
