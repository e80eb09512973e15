"""The variables of a fitted body, independent of the crop in which it was fitted.

In ``WorldPose`` the root's position is in mm from the camera, and its orientation is one rotation: angles about three
axes are discontinuous at a pole, and do not measure angular speed. A left hand is in mirrored space, as in the fit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handpose.fit.body import CapsuleModel
from netlib.blob import Array


class WorldPose(NamedTuple):
    """A body in space.

    place     (3,) mm, position of the root in the axes of the (mirrored) camera
    rotation  (3, 3) world_from_root
    others    (V - 6,) the other variables: limbs, the surface's own, logarithms of size and thickness
    """

    place: Array
    rotation: Array
    others: Array


def world_pose(model: CapsuleModel, x: Array, center_mm: Array) -> WorldPose:
    """The body with x (V,) about a crop's centre (3,). Raises NetlibError for a root that cannot be followed."""
    root, rows = model.root_motion, x[None]
    return WorldPose(root.place(rows)[0] + center_mm, root.rotation(rows)[0], x[root.others])


def variables_of(model: CapsuleModel, body: WorldPose, center_mm: Array) -> Array:
    """x (V,) of a body about a crop's centre (3,), with the root's angles between -pi and pi. Raises NetlibError."""
    root, x = model.root_motion, np.empty(model.variables)
    x[root.others] = body.others
    x[root.columns] = root.variables((body.place - center_mm)[None], body.rotation[None])[0]
    return x
