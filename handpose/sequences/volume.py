"""The volume of possible hand positions in front of a camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handpose.facts.cameras import Camera
from netlib.blob import Array

MARGIN_MM = 155.0  # from the middle of a crop to the border of the volume
GONE_MM = 330.0  # from the border of the image to the middle of a hand that is away


class Volume(NamedTuple):
    """The volume of a moving hand: a part of the image, and depths in mm."""

    camera: Camera
    left: float = 0.0  # 0 to 1 of the image's width
    right: float = 1.0
    near: float = 450.0
    far: float = 850.0

    def roomy(self) -> Volume:
        """The volume, starting far enough from the camera for a hand and its movement."""
        c = self.camera
        needed = 1.15 * 2 * MARGIN_MM * max(c.fx / ((self.right - self.left) * c.width), c.fy / c.height)
        return self._replace(near=max(self.near, needed), far=max(self.far, 1.4 * needed))

    def place(self, rng: np.random.Generator) -> Array:
        """A place (3,) for the middle of a hand, in mm."""
        c, z = self.camera, rng.uniform(self.near, self.far)
        across, down = MARGIN_MM * c.fx / z, MARGIN_MM * c.fy / z
        u = rng.uniform(self.left * c.width + across, self.right * c.width - across)
        return c.unproject((u, rng.uniform(down, c.height - down), z))

    def kept(self, place: Array) -> Array:
        """The place (3,) within the volume that is nearest to another, about."""
        c, z = self.camera, float(np.clip(place[2], self.near, self.far))
        across, down = MARGIN_MM * c.fx / z, MARGIN_MM * c.fy / z
        u, v, _ = c.project([place[0], place[1], z])
        u = np.clip(u, self.left * c.width + across, self.right * c.width - across)
        return c.unproject((u, np.clip(v, down, c.height - down), z))

    def outside(self, place: Array) -> Array:
        """The position (3,) outside the image next to another one, at the closer side."""
        c, z = self.camera, place[2]
        u, v, _ = c.project(place)
        margin = GONE_MM * c.fx / z
        return c.unproject((-margin if u < (c.width - 1) / 2 else c.width + margin, v, z))
