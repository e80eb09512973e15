"""The cameras of whole scenes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.estimate.finder import FOCAL_PX
from handpose.frames.cameras import Floats
from handpose.synthetic.scenes.prior import ViewParameter
from handpose.synthetic.scenes.solids import Rays
from netlib.blob import Array

HEIGHT, WIDTH = 128, 160


class Cameras(NamedTuple):
    """The cameras of N frames: focal lengths and principal points in px, (N,) each; and where
    they are.
    """

    focal: Array
    u0: Array
    v0: Array
    on_head: NDArray[np.bool_]
    facing: NDArray[np.bool_]  # in front of the person
    up: Array  # (N, 3) the direction upwards

    def rays(self) -> Rays:
        """Slopes of the columns (N, WIDTH), and of the rows (N, HEIGHT), downwards."""
        x = (np.arange(WIDTH) - self.u0[:, None]) / self.focal[:, None]
        y = (np.arange(HEIGHT) - self.v0[:, None]) / self.focal[:, None]
        return x.astype(np.float32), y.astype(np.float32)

    def pixels(self, xyz: Array) -> Array:
        """Columns and rows (N, ..., 2) of points (N, ..., 3)."""
        z = np.maximum(xyz[..., 2], 50)
        each = (-1, *[1] * (xyz.ndim - 2))
        f, u0, v0 = (value.reshape(each) for value in (self.focal, self.u0, self.v0))
        u = u0 + f * xyz[..., 0] / z
        v = v0 - f * xyz[..., 1] / z
        return np.stack([u, v], axis=-1)

    def at(self, u: Array, v: Array, z: Array) -> Array:
        """The points (N, 3) at pixels and depths (N,)."""
        x = (u - self.u0) / self.focal * z
        y = (self.v0 - v) / self.focal * z
        return np.stack([x, y, z], axis=-1)

    def anywhere(self, rng: np.random.Generator, margin: float, z: Array) -> Array:
        """Random points (N, 3) at depths (N,), ``margin`` px or more inside the frames' borders."""
        u = rng.uniform(margin, WIDTH - margin, len(z))
        v = rng.uniform(margin, HEIGHT - margin, len(z))
        return self.at(u, v, z)


def draw_cameras(rng: np.random.Generator, prior: ViewParameter, count: int) -> Cameras:
    """Cameras worn on a head, in front of a person, or anywhere; held in any way."""
    focal = FOCAL_PX * prior.focal.draw(rng, count)
    u0 = WIDTH / 2 + rng.uniform(-prior.shift_x, prior.shift_x, count)
    v0 = HEIGHT / 2 + rng.uniform(-prior.shift_y, prior.shift_y, count)
    where = rng.random(count)
    on_head, facing = where < prior.on_head, where > 1 - prior.facing
    pitch = np.where(on_head, prior.pitch_on_head.draw(rng, count), prior.pitch.draw(rng, count))
    any_roll = rng.random(count) < np.where(on_head, prior.any_roll_on_head, prior.any_roll)
    roll = np.where(any_roll, rng.uniform(-180, 180, count), prior.roll * rng.normal(size=count))
    down, turned = np.deg2rad(pitch), np.deg2rad(roll)
    level = np.cos(down)
    x, y = level * np.sin(turned), level * np.cos(turned)
    up = np.stack([x, y, -np.sin(down)], axis=1)
    return Cameras(focal, u0, v0, on_head, facing, up)


def slopes_of(rays: Rays) -> Floats:
    """Slopes (N, H, W, 2) x / z and y / z, upwards, of the rays through all pixels."""
    x, y = rays
    return np.stack(np.broadcast_arrays(x[:, None, :], -y[:, :, None]), axis=-1)
