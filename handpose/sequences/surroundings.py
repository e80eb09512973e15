"""What surrounds moving hands: the volume in which they may be, a wall, a person, upper arms, a table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handpose.body.render import Capsules, Floats, in_front
from handpose.body.sides import Side
from handpose.frames.cameras import Camera
from handpose.synthetic.scenes import BODY, render_image
from netlib.blob import Array

NOWHERE_MM = 1e4  # beyond the range of any camera
BEHIND_MM = 300.0  # from the farthest place of a hand to the middle between the shoulders
SHOULDER_MM = 170.0  # from that middle

MARGIN_MM = 155.0  # from the middle of a crop to the border of the volume
GONE_MM = 330.0  # from the border of the image to the middle of a hand that is away


class Surroundings(NamedTuple):
    """Everything in the image except hands and arms.

    image   (height, width) mm, ``NOWHERE_MM`` without a reading
    middle  (3,) mm between the person's shoulders
    """

    image: Floats
    middle: Array

    def upper_arm(self, elbow: Array, side: Side) -> Capsules:
        """The capsule (1, 1) from an elbow (3,) to the shoulder of the person, who faces the camera."""
        right = -1.0 if side == "right" else 1.0
        shoulder = self.middle + (right * SHOULDER_MM, -20.0, 0.0)
        return Capsules(elbow[None, None], shoulder[None, None], np.array([[40.0]]), np.array([[55.0]]))


def draw_surroundings(rng: np.random.Generator, camera: Camera, farthest: float, body: bool) -> Surroundings:
    """A wall, beyond the range of half of the cameras, and a body in front of it or none.

    farthest  depth in mm that the middles of hands do not exceed
    """
    middle = np.array([rng.uniform(-60, 60), rng.uniform(-120, 40), farthest + BEHIND_MM])
    wall = float(rng.uniform(middle[2] + 300, middle[2] + 1500))
    image = np.full((camera.height, camera.width), wall if rng.random() < 0.5 else NOWHERE_MM, dtype=np.float32)
    if body:
        ends = np.array([(a, b) for a, b, _, _ in BODY], dtype=np.float64) + middle
        radii = np.array([(ra, rb) for _, _, ra, rb in BODY], dtype=np.float64)
        trunk = in_front(Capsules(ends[None, :, 0], ends[None, :, 1], radii[None, :, 0], radii[None, :, 1]))
        np.minimum(image, render_image(trunk, camera, np.inf)[0], out=image)
    return Surroundings(image, middle)


def draw_desk(rng: np.random.Generator, camera: Camera, farthest: float) -> Surroundings:
    """A person at a table, seen from above: the trunk at the lower edge, a table that rises beyond it, and the floor.

    farthest  depth in mm that the middles of hands do not exceed; the table is close behind
    """
    floor = farthest + float(rng.uniform(500, 900))
    low = -farthest * (camera.height - 1 - camera.v0) / camera.fy  # y of the image's lower edge
    edge, lies, rise = low + rng.uniform(150, 300), farthest + rng.uniform(60, 140), rng.uniform(-0.1, 0.4)
    middle = np.array([rng.uniform(-60, 60), low - 100, farthest - rng.uniform(0, 150)])
    x = (np.arange(camera.width) - camera.u0) / camera.fx
    y = ((camera.v0 - np.arange(camera.height)) / camera.fy)[:, None]
    # The plane z = lies + rise (y - edge), where y is the ray's slope times z.
    z = (lies - rise * edge) / np.maximum(1 - rise * y, 1e-3) + 0 * x
    image = np.where(y * z > edge, z, floor).astype(np.float32)
    a = middle + np.array([(-110, 0, 0), (-70, 40, 30)])
    b = middle + np.array([(110, 0, 0), (70, edge - middle[1] - 60, 90)])
    radii = np.array([[(110.0, 110.0), (120.0, 100.0)]])
    trunk = in_front(Capsules(a[None], b[None], radii[..., 0], radii[..., 1]))
    np.minimum(image, render_image(trunk, camera, np.inf)[0], out=image)
    return Surroundings(image, middle)


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
