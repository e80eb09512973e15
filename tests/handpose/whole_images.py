"""Whole depth images of hands, to test what is made for crops."""

from __future__ import annotations

import numpy as np

from handpose.facts.cameras import NYU, Camera
from handpose.synthetic.render import Capsules, Floats, render


def render_image(capsules: Capsules, camera: Camera = NYU, background: float = np.inf) -> Floats:
    """Depth (N, height, width) in mm of the whole image; ``background`` where there is no capsule."""
    N = len(capsules.a)
    x = np.broadcast_to((np.arange(camera.width) - camera.u0) / camera.fx, (N, camera.width))
    y = np.broadcast_to((np.arange(camera.height) - camera.v0) / camera.fy, (N, camera.height))
    return render(capsules, x, y, np.full(N, background))
