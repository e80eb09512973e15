"""Errors of whole depth frames, in addition to those of ``sensor``.

Filters of stereo cameras smooth neighbouring surfaces together, so that fingers merge. At the edges
of near surfaces, one of the two cameras does not see what lies behind. Readings are missing in
patches and beyond the range, or wrong.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera, Floats
from handpose.synthetic.sensor import (
    CODED_LIGHT,
    KINECT,
    NOISY_KINECT,
    STEREO,
    TIME_OF_FLIGHT,
    sense,
)

NO_READING_MM = 8000.0  # the depth of pixels of a whole frame without a reading
MERGED_MM = 60.0  # surfaces nearer together are smoothed into one
# A frame has each error with a probability P_..., and draws its numbers between two bounds.
P_SMOOTH = 0.8  # of cameras that smooth
SMOOTH_STD_PX = (0.6, 2.2)  # of the filter
P_SHORT_RANGE = 0.4
SHORT_RANGE_MM, LONG_RANGE_MM = (900.0, 2500.0), 6000.0
P_SHADOW = 0.7  # behind edges, of cameras with a baseline
SHADOW_BASELINE_MM = (20.0, 75.0)
P_HOLES, P_HOLES_IN_HANDS = 0.5, 0.35  # where smooth noise is above ...
HOLE_LEVEL = (1.0, 2.2)  # ... a level
P_STRIP = 0.3  # at the left, which one of the cameras does not see
MAX_STRIP_PX = 25
P_SPECKS = 0.3  # pixels with a wrong depth
SPECK_SHARE, SPECK_MM = (0.0, 0.004), (200, 1500)
P_DIM = 0.35  # dark things are not read beyond a depth, ...
DIM_STD = 0.15  # ... whose logarithm has this deviation from place to place
P_ISLANDS = 0.3  # what is far away is read only where smooth noise is above ...
ISLAND_LEVEL, ISLAND_PX = (-0.3, 1.3), (8, 28)  # ... a level; with a grain of this size
# Far away begins at the farthest hand's depth, or without hands at this one, times a factor.
NO_HAND_MM, FAR_FACTOR = (300.0, 1200.0), (1.05, 4.0)
# sensors with equal probability, and whether the camera smooths
FRAME_SENSORS = (
    (KINECT, False),
    (NOISY_KINECT, False),
    (CODED_LIGHT, False),
    (TIME_OF_FLIGHT, False),
    (STEREO, True),
    (STEREO, True),
)
MAX_SHADOW_PX = 20  # exclusive
# Focal lengths of cameras; those with larger ones have errors of several pixels. At 160 px the
# errors are those of the frames that the finder is trained on. A RealSense with 322 px merges the
# fingers of hands at a desk as these do.
CAMERA_FOCAL_PX = (150.0, 300.0)
P_INTERPOLATED = 0.5  # of views with more pixels than the camera's; the others repeat its pixels
SHADOW_MARGIN_PX = 0.3  # a pixel is hidden from this distance before the edge on


def measure_frame(
    rng: np.random.Generator, depth: Floats, hand: NDArray[np.bool_], focal: float, reflects: Floats
) -> Floats:
    """A frame (H, W) in mm as a random camera measures it, 0 where it reads nothing.

    depth     infinite where there is no surface
    hand      (H, W) pixels of hands, of which fewer holes take a part
    focal     focal length in px
    reflects  (H, W) the part of the light that surfaces send back
    """
    sensor, smooths = FRAME_SENSORS[rng.integers(len(FRAME_SENSORS))]
    height, width = depth.shape
    # The sensors' pixels are smaller than these: as if the frame were one of a camera of three
    # times the resolution.
    fine = Camera("fine", 3 * focal, 3 * focal, 0, 0, 3 * width, 3 * height)
    clean = np.minimum(depth, np.float32(NO_READING_MM))
    out = sense(rng, clean[None], np.array([NO_READING_MM]), sensor.settled(rng), fine)[0]
    if smooths and rng.random() < P_SMOOTH:
        out = _merged(out, rng.uniform(*SMOOTH_STD_PX))
    has_short_range = rng.random() < P_SHORT_RANGE
    range_mm = rng.uniform(*SHORT_RANGE_MM) if has_short_range else LONG_RANGE_MM
    lost = out >= range_mm
    if sensor.baseline and rng.random() < P_SHADOW:
        lost |= _shadow(rng, clean, focal * rng.uniform(*SHADOW_BASELINE_MM))
    if rng.random() < P_HOLES:
        hole = _smooth_noise(rng, depth) > rng.uniform(*HOLE_LEVEL)
        lost |= hole if rng.random() < P_HOLES_IN_HANDS else hole & ~hand
    lost |= ~hand & _lost_far_away(rng, clean, _far_mm(rng, clean, hand), reflects)
    if rng.random() < P_STRIP:
        lost[:, : rng.integers(MAX_STRIP_PX)] = True
    out = np.where(lost, np.float32(0), np.round(out))
    if rng.random() < P_SPECKS:
        speck = rng.random(out.shape) < rng.uniform(*SPECK_SHARE)
        out[speck] = rng.integers(*SPECK_MM, int(speck.sum()))
    return np.asarray(out, np.float32)


def measure_fine(
    rng: np.random.Generator, depth: Floats, hand: NDArray[np.bool_], focal: float, reflects: Floats
) -> Floats:
    """``measure_frame`` of a view (H, W) that has more pixels than the camera, as a crop of a far
    hand has: its errors have the size of the camera's pixels.
    """
    low, high = np.log(CAMERA_FOCAL_PX)
    share = min(float(np.exp(rng.uniform(low, high))) / focal, 1.0)
    rows, columns = (_spaced(length, share) for length in depth.shape)
    at = np.ix_(rows, columns)
    own_focal = focal * len(rows) / len(depth)
    frame = measure_frame(rng, depth[at], hand[at], own_focal, reflects[at])
    return enlarged(frame, depth.shape, is_interpolated=rng.random() < P_INTERPOLATED)


def _spaced(length: int, share: float) -> NDArray[np.int_]:
    """The indices of a share of the pixels of an axis, equally far apart."""
    count = round(length * share)
    middles = (np.arange(count) + 0.5) * length / count
    return middles.astype(int)


def enlarged(depth: Floats, shape: tuple[int, ...], is_interpolated: bool) -> Floats:
    """Readings in mm, 0 where there is none, in an image of another shape (H, W), of repeated or
    interpolated pixels.

    Only within surfaces pixels are interpolated.
    """
    height, width = shape

    def resized(image: NDArray[Any], how: int = cv2.INTER_NEAREST) -> NDArray[Any]:
        return cv2.resize(image, (width, height), interpolation=how)

    repeated = resized(depth)
    if not is_interpolated:
        return repeated
    around = np.ones((3, 3), np.uint8)
    nearest, farthest = resized(cv2.erode(depth, around)), resized(cv2.dilate(depth, around))
    is_surface = (nearest > 0) & (farthest - nearest < MERGED_MM)
    return np.where(is_surface, resized(depth, cv2.INTER_LINEAR), repeated)


def _far_mm(rng: np.random.Generator, depth: Floats, hand: NDArray[np.bool_]) -> float:
    """A depth in mm behind all hands, from which a camera may read less."""
    farthest = float(depth[hand].max()) if hand.any() else rng.uniform(*NO_HAND_MM)
    return farthest * float(np.exp(rng.uniform(*np.log(FAR_FACTOR))))


def _lost_far_away(
    rng: np.random.Generator, depth: Floats, far_mm: float, reflects: Floats
) -> NDArray[np.bool_]:
    """Pixels (H, W) without a reading because they are dark, or outside islands of readings."""
    lost = np.zeros(depth.shape, bool)
    if rng.random() < P_DIM:
        max_mm = far_mm * np.sqrt(reflects) * np.exp(DIM_STD * _smooth_noise(rng, depth))
        lost |= depth > max_mm
    if rng.random() < P_ISLANDS:
        noise = _smooth_noise(rng, depth, int(rng.integers(*ISLAND_PX)))
        lost |= (depth > far_mm) & (noise < rng.uniform(*ISLAND_LEVEL))
    return lost


def _merged(depth: Floats, sigma: float) -> Floats:
    """Depth smoothed by a Gaussian filter of ``sigma`` px within surfaces that are close together,
    with the gaps between fingers filled.
    """
    # far gaps take the near depth
    closed = cv2.morphologyEx(depth, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    filled = np.where(depth - closed < MERGED_MM, np.minimum(depth, closed), depth)
    total, weights = np.zeros_like(filled), np.zeros_like(filled)
    radius = int(np.ceil(2 * sigma))
    padded = cv2.copyMakeBorder(filled, radius, radius, radius, radius, cv2.BORDER_REPLICATE)
    height, width = depth.shape
    for i in range(2 * radius + 1):
        for j in range(2 * radius + 1):
            other = padded[i : i + height, j : j + width]
            is_near = np.abs(other - filled) < MERGED_MM
            squares = (i - radius) ** 2 + (j - radius) ** 2
            weight = is_near * np.exp(-squares / (2 * sigma * sigma))
            total += weight * other
            weights += weight
    return np.asarray(total / weights, np.float32)


def _shadow(rng: np.random.Generator, depth: Floats, baseline_px: float) -> NDArray[np.bool_]:
    """Pixels (H, W) whose surface a second camera, to the left or right, does not see
    behind a nearer one.
    """
    disparity = baseline_px / depth  # px mm / mm
    if mirrored := rng.random() < 0.5:
        disparity = disparity[:, ::-1]
    hidden = np.zeros(depth.shape, bool)
    for k in range(1, MAX_SHADOW_PX):
        rise = disparity[:, k:] - disparity[:, :-k]
        hidden[:, :-k] |= rise > k - SHADOW_MARGIN_PX
    return hidden[:, ::-1] if mirrored else hidden


def _smooth_noise(rng: np.random.Generator, depth: Floats, grain: int = 8) -> Floats:
    """Smooth noise of the shape (H, W) of a depth image, with a grain in px."""
    height, width = depth.shape
    coarse = rng.standard_normal((height // grain + 1, width // grain + 1), dtype=np.float32)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR))
