"""The output of the tracker for one hand, as in ``handpose.track_files``."""

from __future__ import annotations

import numpy as np

from handpose.depth_fit.body import SIZE
from handpose.facts.sides import mirror_of
from handpose.track_files.track import TrackedHand
from handpose.tracking.following import Follower
from handpose.tracking.looking import Looker


def told(follower: Follower, looker: Looker, *, smooth: bool, flesh: bool) -> TrackedHand:
    """A hand at its last pose.

    smooth  use the smoothed pose
    flesh   include the surface
    """
    seen, model = follower.best, looker.fitter.model
    sight, side = seen.sight, seen.sight.aim.side
    mirror = mirror_of(side)
    x = looker.placer.variables(seen.smooth if smooth else sight.body, sight.center_mm)[None]
    if follower.size is not None:
        x[0, SIZE] = np.log(follower.size)  # the known size, instead of a filtered one
    capsules = None
    if flesh:
        capsules = model.capsules(x, sight.center_mm[None]).mirrored(mirror)
    return TrackedHand(
        id=follower.id,
        hand=side,
        confidence=float(sight.fit.confidence[0]),
        error_mm=float(sight.fit.error_mm[0]),
        inputs=model.inputs_of(x)[0],
        bones=model.skeleton.bones * float(np.exp(x[0, SIZE])),
        origin_mm=sight.center_mm * mirror,
        xyz=(model.joints(x)[0] + sight.center_mm) * mirror,
        center_uvd=sight.aim.center_uvd,
        cube_mm=looker.cube_mm,
        capsules=capsules,
    )
