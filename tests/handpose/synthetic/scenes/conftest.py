"""People in scenes."""

from __future__ import annotations

import numpy as np

from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.scenes.cameras import Cameras, draw_cameras
from handpose.synthetic.scenes.draws import Draw
from handpose.synthetic.scenes.people import People, draw_people
from handpose.synthetic.scenes.prior import ScenePrior
from handpose.synthetic.whole_scenes import SceneGenerator
from netlib.proto import schema


def drawn(
    rng: np.random.Generator, count: int, **hands: float
) -> tuple[ScenePrior, Cameras, People]:
    """A prior whose ``hands { ... }`` have other numbers, and cameras and people of it."""
    prior = scene_prior.load()
    prior = schema.changed(prior, hands=schema.changed(prior.hands, **hands))
    draw = Draw(rng, count)
    cameras = draw_cameras(draw, prior.view)
    return prior, cameras, draw_people(draw, prior, SceneGenerator().sampler, cameras)
