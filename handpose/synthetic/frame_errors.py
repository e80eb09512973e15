"""Errors of depth cameras in whole frames: those of ``sensor``, and what only a whole frame shows.

Filters of stereo cameras smooth neighbouring surfaces together, so that fingers merge. At the edges of near surfaces,
one of the two cameras does not see what lies behind. Readings are missing in patches and beyond the range, or wrong.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Floats
from handpose.frames.cameras import Camera
from handpose.synthetic.sensor import CODED_LIGHT, KINECT, NOISY_KINECT, TIME_OF_FLIGHT, Sensor, sense

FAR_MM = 8000.0  # the depth of pixels without a reading, within this module
CLOSE_MM = 60.0  # surfaces nearer together are smoothed into one
STEREO = Sensor(
    pixel_shift=(0.0, 0.4), block_shift=(0.0, 0.7), baseline=50.0, disparity_noise=(0.0, 0.1), disparity_step=0.03125,
    dropout=(0.0, 0.5), holes=(0.0, 0.01), spread=(0.0, 1.5),
)
KINDS = ((KINECT, False), (NOISY_KINECT, False), (CODED_LIGHT, False), (TIME_OF_FLIGHT, False),
         (STEREO, True), (STEREO, True))  # and whether the camera smooths


def measure(rng: np.random.Generator, depth: Floats, hand: NDArray[np.bool_], focal: float) -> Floats:
    """A frame (H, W) in mm as a random camera measures it, 0 where it reads nothing.

    depth  infinite where there is no surface
    hand   (H, W) pixels of hands, of which fewer holes take a part
    focal  focal length in px
    """
    sensor, smooths = KINDS[int(rng.integers(len(KINDS)))]
    height, width = depth.shape
    # The sensors' pixels are smaller than these: as if the frame were one of a camera of three times the resolution.
    fine = Camera("fine", 3 * focal, 3 * focal, 0, 0, 3 * width, 3 * height)
    clean = np.minimum(depth, np.float32(FAR_MM))
    out = sense(rng, clean[None], np.array([FAR_MM]), sensor.settled(rng), fine)[0]
    if smooths and rng.random() < 0.8:
        out = _merged(out, float(rng.uniform(0.6, 2.2)))
    lost = out >= min(FAR_MM, float(rng.uniform(900, 2500)) if rng.random() < 0.4 else 6000.0)
    if sensor.baseline and rng.random() < 0.7:
        lost |= _shadow(rng, clean, focal * rng.uniform(20, 75))
    if rng.random() < 0.5:
        hole = _patches(rng, depth.shape) > rng.uniform(1.0, 2.2)
        lost |= hole if rng.random() < 0.35 else hole & ~hand
    if rng.random() < 0.3:
        lost[:, : int(rng.integers(25))] = True  # the strip that one of the cameras does not see
    out = np.where(lost, np.float32(0), np.round(out))
    if rng.random() < 0.3:
        speck = rng.random(out.shape) < rng.uniform(0, 0.004)
        out[speck] = rng.integers(200, 1500, int(speck.sum()))
    return np.asarray(out, np.float32)


def _merged(depth: Floats, sigma: float) -> Floats:
    """Depth smoothed within surfaces that are close together, with the gaps between fingers filled."""
    closed = cv2.morphologyEx(depth, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))  # far gaps take the near depth
    filled = np.where(depth - closed < CLOSE_MM, np.minimum(depth, closed), depth)
    total, weight = np.zeros_like(filled), np.zeros_like(filled)
    reach = int(np.ceil(2 * sigma))
    around = cv2.copyMakeBorder(filled, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    height, width = depth.shape
    for i in range(2 * reach + 1):
        for j in range(2 * reach + 1):
            other = around[i : i + height, j : j + width]
            near = np.abs(other - filled) < CLOSE_MM
            own = near * np.exp(-((i - reach) ** 2 + (j - reach) ** 2) / (2 * sigma * sigma))
            total += own * other
            weight += own
    return np.asarray(total / weight, np.float32)


def _shadow(rng: np.random.Generator, depth: Floats, baseline_px: float) -> NDArray[np.bool_]:
    """Pixels (H, W) whose surface a second camera, to the left or right, does not see behind a nearer one."""
    disparity = baseline_px / depth  # px mm / mm
    if mirrored := rng.random() < 0.5:
        disparity = disparity[:, ::-1]
    hidden = np.zeros(depth.shape, bool)
    for k in range(1, 20):
        hidden[:, :-k] |= disparity[:, k:] - disparity[:, :-k] > k - 0.3
    return hidden[:, ::-1] if mirrored else hidden


def _patches(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
    """Smooth noise (H, W) with a grain of 8 px."""
    coarse = rng.standard_normal((shape[0] // 8 + 1, shape[1] // 8 + 1), dtype=np.float32)
    return np.asarray(cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
