"""The static surroundings of moving hands, a wall and a person, and the moving upper arms."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handpose.facts.cameras import Camera
from handpose.facts.sides import Side
from handpose.surface.render import Capsules, Floats, in_front
from handpose.synthetic.scenes import BODY, render_image
from netlib.blob import Array

NOWHERE_MM = 1e4  # beyond the range of any camera
BEHIND_MM = 300.0  # from the farthest place of a hand to the middle between the shoulders
SHOULDER_MM = 170.0  # from that middle
BESIDE_MM = 750.0  # from one person to the next


class Surroundings(NamedTuple):
    """Everything in the image except hands and arms.

    image   (height, width) mm, ``NOWHERE_MM`` without a reading
    middle  (3,) mm between the shoulders of the first person
    """

    image: Floats
    middle: Array

    def upper_arm(self, elbow: Array, side: Side, person: int) -> Capsules:
        """The capsule (1, 1) from an elbow (3,) to the shoulder of a person who faces the camera."""
        right = -1.0 if side == "right" else 1.0
        shoulder = self.middle + (right * SHOULDER_MM + person * BESIDE_MM, -20.0, 0.0)
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
