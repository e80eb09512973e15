"""Errors of depth cameras: ragged edges, quantised noise, flying pixels, pixels without a reading.

    sense(rng, depth, far, KINECT, camera)

The errors are applied in the order in which they arise: near surfaces cover what is behind their
edges (``_spread``), matching takes the depth of a neighbour (``_shift``), light from both sides of
an edge gives a depth between them (``_fly``), disparity or depth is noisy and rounded
(``_quantise_disparity``, ``_quantise_depth``), and some pixels at depth steps have no reading
(``_drop``). After a change of this code synthetic frames differ: increase
``handpose.synthetic.generator.VERSION``.

``frame_errors`` has what only whole frames show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.frames.cameras import Camera, Floats
from netlib.blob import blocks, divide_up

_CHUNK = 4  # frames per batch, so that their arrays stay in the cache
_BYTE_STD = 256 / 12**0.5  # deviation of a uniformly random byte


@dataclass(frozen=True)
class Sensor:
    """By default a Kinect v1, which measures disparity (focal length x baseline / depth) by
    matching small windows.

    Without a baseline it is a time-of-flight camera, whose noise grows with the squared depth,
    because light gets weaker. Where there are two numbers, each frame draws its own between
    them, uniformly.
    """

    # px of the crop: standard deviation of the shift of a pixel
    pixel_shift: tuple[float, float] = (0.0, 0.3)
    # px of the crop: the same for 4 x 4 pixels together
    block_shift: tuple[float, float] = (0.2, 0.7)
    baseline: float = 75.0  # mm between projector and camera
    disparity_noise: tuple[float, float] = (0.0, 0.08)  # px of the image (deviation)
    disparity_step: float = 0.125  # px of the image: quantisation of the disparity
    depth_noise: tuple[float, float] = (0.0, 0.0)  # mm at 1 m, without a baseline (deviation)
    depth_step: float = 1.0  # mm: quantisation of the depth without a baseline
    # fraction of the pixels at an edge that read a depth between both sides
    flying: tuple[float, float] = (0.0, 0.0)
    edge: float = 15.0  # mm between neighbours that make an edge
    # fraction of the pixels at an edge that are not read
    dropout: tuple[float, float] = (0.0, 0.12)
    # fraction of the pixels at an edge round which 3 x 3 are not read
    holes: tuple[float, float] = (0.0, 0.006)
    # px of the image by which a surface extends beyond its edges
    spread: tuple[float, float] = (0.0, 0.0)

    def settled(self, rng: np.random.Generator) -> Sensor:
        """One camera of this kind: what each frame draws is drawn once, and the same
        in all frames.
        """
        drawn: dict[str, Any] = {}
        for name, bounds in vars(self).items():
            # a sensor without spread draws none, so that its recordings do not change
            if isinstance(bounds, tuple) and (name != "spread" or bounds[1]):
                drawn[name] = (rng.uniform(*bounds),) * 2
        return replace(self, **drawn)


KINECT = Sensor()
# Short-range coded light (RealSense SR300 and SR305): fine steps, torn edges, more holes.
CODED_LIGHT = Sensor(
    pixel_shift=(0.0, 0.5),
    block_shift=(0.0, 0.4),
    baseline=48.0,
    disparity_noise=(0.0, 0.15),
    disparity_step=0.03125,
    flying=(0.0, 0.1),
    dropout=(0.0, 0.4),
    holes=(0.0, 0.02),
)
# Time of flight (Kinect v2, Azure Kinect): no blocks and no steps, noise of millimetres,
# flying pixels.
TIME_OF_FLIGHT = Sensor(
    pixel_shift=(0.0, 0.3),
    block_shift=(0.0, 0.0),
    baseline=0.0,
    depth_noise=(0.5, 5.0),
    flying=(0.1, 0.5),
    dropout=(0.0, 0.3),
    holes=(0.0, 0.004),
)
# A Kinect with large errors.
NOISY_KINECT = Sensor(
    pixel_shift=(0.2, 0.6),
    block_shift=(0.4, 1.2),
    disparity_noise=(0.05, 0.2),
    dropout=(0.05, 0.3),
    holes=(0.0, 0.015),
)
# A stereo camera, of whole frames: block matching, and surfaces that extend beyond their edges.
STEREO = Sensor(
    pixel_shift=(0.0, 0.4),
    block_shift=(0.0, 0.7),
    baseline=50.0,
    disparity_noise=(0.0, 0.1),
    disparity_step=0.03125,
    dropout=(0.0, 0.5),
    holes=(0.0, 0.01),
    spread=(0.0, 1.5),
)


def sense(
    rng: np.random.Generator,
    depth: Floats,
    far: NDArray[np.floating],
    sensor: Sensor,
    camera: Camera,
    pixel: ArrayLike = 1.0,
) -> Floats:
    """Depth (N, H, W) in mm as ``sensor`` measures it.

    far    (N,) mm, the background, also for missing readings
    pixel  size of a pixel of the camera's image in pixels of ``depth``, one or (N,)
    """
    pixels = np.broadcast_to(np.asarray(pixel, np.float64), len(depth))
    if sensor.spread[1]:
        depth = _spread(rng, depth, sensor, pixels)
    out = np.empty_like(depth)
    limits = np.asarray(far, dtype=np.float32)[:, None, None]
    for chunk in blocks(len(depth), _CHUNK):
        some, limit = _shift(rng, depth[chunk], sensor), limits[chunk]
        if sensor.flying[1]:
            _fly(rng, some, limit, sensor)
        if sensor.baseline:
            _quantise_disparity(rng, some, limit, sensor, camera.fx * sensor.baseline)
        else:
            _quantise_depth(rng, some, limit, sensor)
        _drop(rng, some, limit, sensor)
        out[chunk] = some
    return out


def _draw(rng: np.random.Generator, bounds: tuple[float, float], count: int) -> Floats:
    """One number per frame between ``bounds``, (count, 1, 1)."""
    return rng.uniform(*bounds, (count, 1, 1)).astype(np.float32)


def _noise(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.int8]:
    """Random bytes, the cheapest random numbers."""
    count = int(np.prod(shape))
    words = rng.integers(0, 2**64, divide_up(count, 8), dtype=np.uint64)
    return words.view(np.int8)[:count].reshape(shape)


def _spread(
    rng: np.random.Generator, depth: Floats, sensor: Sensor, pixel: NDArray[np.float64]
) -> Floats:
    """Depth in which surfaces extend beyond their edges, as with matching windows and filters."""
    out = depth.copy()
    for n, radius in enumerate(rng.uniform(*sensor.spread, len(depth)) * pixel):
        if radius >= 1:  # otherwise no other pixel is close enough
            steps = np.arange(-int(radius), int(radius) + 1)
            disc = steps**2 + steps[:, None] ** 2 <= radius**2
            nearest = cv2.erode(depth[n], disc.astype(np.uint8))
            covered = depth[n] - nearest > sensor.edge
            out[n][covered] = nearest[covered]
    return out


def _shift(rng: np.random.Generator, depth: Floats, sensor: Sensor) -> Floats:
    """Each pixel takes the depth of a neighbour: the ragged outline of block matching."""
    N, H, W = depth.shape
    by_pixel = _draw(rng, sensor.pixel_shift, N) / np.float32(_BYTE_STD)
    by_block = _draw(rng, sensor.block_shift, N)
    coarse = N, divide_up(H, 4), divide_up(W, 4)
    columns, rows = np.arange(W, dtype=np.float32), np.arange(H, dtype=np.float32)[:, None]
    shifted = []
    for positions in (columns, rows):
        blocks = rng.standard_normal(coarse, dtype=np.float32) * by_block
        x = _noise(rng, (N, H, W)) * by_pixel
        wide = np.repeat(blocks, 4, axis=2)[:, :, :W]
        x += np.repeat(wide, 4, axis=1)[:, :H]
        x += positions
        np.rint(x, out=x)
        shifted.append(np.clip(x, 0, positions.size - 1, out=x))
    column, index = shifted
    index += np.arange(N, dtype=np.float32)[:, None, None] * H
    index *= W  # below 2^24, so exact
    index += column
    return depth.reshape(-1)[index.astype(np.int32)]


def _quantise_disparity(
    rng: np.random.Generator, depth: Floats, far: Floats, sensor: Sensor, focal_baseline: float
) -> None:
    """Noise and rounding of the disparity, in place."""
    seen, true, deviation = _readings(rng, depth, far, sensor.disparity_noise)
    disparity = np.float32(focal_baseline) / true
    # the sum of two uniform numbers approximates a normal one
    noise = np.add(*_noise(rng, (2, len(seen))), dtype=np.int16)
    scale = np.float32(1 / (_BYTE_STD * 2**0.5))
    disparity += noise * (deviation * scale)
    disparity *= np.float32(1 / sensor.disparity_step)
    np.rint(disparity, out=disparity)
    depth.reshape(-1)[seen] = np.float32(focal_baseline / sensor.disparity_step) / disparity


def _quantise_depth(rng: np.random.Generator, depth: Floats, far: Floats, sensor: Sensor) -> None:
    """Noise and rounding of the depth, in place."""
    seen, true, deviation = _readings(rng, depth, far, sensor.depth_noise)
    noise = rng.standard_normal(len(seen), dtype=np.float32) * deviation
    step = np.float32(sensor.depth_step)
    noisy = true + noise * (true / 1000) ** 2
    depth.reshape(-1)[seen] = np.rint(noisy / step) * step


def _readings(
    rng: np.random.Generator, depth: Floats, far: Floats, noise: tuple[float, float]
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Flat indices of the pixels before the background, their depths, and the deviation of each,
    which its frame draws between two bounds.
    """
    deviation = np.broadcast_to(_draw(rng, noise, len(depth)), depth.shape)
    seen = np.flatnonzero(depth < far)
    return seen, depth.reshape(-1)[seen], deviation.reshape(-1)[seen]


def _fly(rng: np.random.Generator, depth: Floats, far: Floats, sensor: Sensor) -> None:
    """Pixels at edges get a depth between their own and that of a neighbour, in place; never
    behind ``far``.
    """
    _, H, W = depth.shape
    flying = _chosen(rng, depth, _at_edges(depth, sensor), sensor.flying)
    frame, row, column = np.unravel_index(flying, depth.shape)
    direction = rng.integers(0, 4, len(flying))
    down = np.array([-1, 1, 0, 0])[direction]
    right = np.array([0, 0, -1, 1])[direction]
    row, column = np.clip(row + down, 0, H - 1), np.clip(column + right, 0, W - 1)
    own, other = depth.reshape(-1)[flying], depth[frame, row, column]
    share = rng.random(len(flying), dtype=np.float32) / 2  # of the neighbour
    mixed = own + share * (other - own)
    limit = far[frame, 0, 0]
    are_surfaces = (own < limit) & (other < limit)
    depth.reshape(-1)[flying] = np.where(are_surfaces, mixed, own)


def _at_edges(depth: Floats, sensor: Sensor) -> NDArray[np.int64]:
    """Flat indices of the pixels with a neighbour at another depth."""
    edge = np.zeros(depth.shape, dtype=bool)
    across = np.abs(np.diff(depth, axis=2)) > sensor.edge
    down = np.abs(np.diff(depth, axis=1)) > sensor.edge
    edge[:, :, 1:] |= across
    edge[:, :, :-1] |= across
    edge[:, 1:] |= down
    edge[:, :-1] |= down
    return np.flatnonzero(edge)


def _chosen(
    rng: np.random.Generator, depth: Floats, pixels: NDArray[np.int64], share: tuple[float, float]
) -> NDArray[np.int64]:
    """Some of the pixels with these flat indices: of each frame a share between two bounds."""
    frame = pixels // depth[0].size
    is_chosen = rng.random(len(pixels)) < _draw(rng, share, len(depth))[frame, 0, 0]
    return pixels[is_chosen]


def _drop(rng: np.random.Generator, depth: Floats, far: Floats, sensor: Sensor) -> None:
    """Pixels and small holes at edges that are not read, in place."""
    _, H, W = depth.shape
    at_edges = _at_edges(depth, sensor)
    dropped = _chosen(rng, depth, at_edges, sensor.dropout)
    holes = _chosen(rng, depth, at_edges, sensor.holes)
    n, row, column = (index[:, None] for index in np.unravel_index(holes, depth.shape))
    down, right = np.arange(9) // 3 - 1, np.arange(9) % 3 - 1
    rows = np.clip(row + down, 0, H - 1)
    columns = np.clip(column + right, 0, W - 1)
    depth[n, rows, columns] = far[n, 0, 0]
    depth.reshape(-1)[dropped] = far[dropped // (H * W), 0, 0]


def sensor_of(camera: Camera) -> Sensor:
    """The error model of a known camera; of others that of time of flight."""
    return {"nyu": KINECT, "sr305": CODED_LIGHT}.get(camera.name, TIME_OF_FLIGHT)
