"""handpose/drawing/flesh.py"""

from __future__ import annotations

import numpy as np

from handpose.drawing import hands
from handpose.drawing.flesh import over_crop
from handpose.facts.cameras import NYU
from handpose.fitting.depth.body import FleshModel
from handpose.flesh.render import normalise_depth, render_crop
from layers.hand import skeleton


def test_flesh_over_its_own_picture() -> None:
    """Where the flesh is, the picture is skin-coloured; elsewhere it is the crop's; reddish where nothing was seen."""
    model, uvd = FleshModel(skeleton.load(), 150.0), np.array([[320.0, 240, 700]])
    x = np.zeros((1, model.variables))
    depth = render_crop(model.capsules(x, NYU.unproject(uvd)), uvd, 300.0)
    crop = normalise_depth(depth, uvd[:, 2], 300.0)[0]
    drawn = over_crop(crop, model.capsules(x, np.zeros((1, 3))), uvd, 300.0, NYU, zoom=2)
    assert drawn.shape == (256, 256, 3) and drawn.dtype == np.uint8
    flesh = np.kron(crop < 1, np.ones((2, 2))) > 0
    blue, _, red = np.moveaxis(drawn.astype(int), -1, 0)
    assert (red[flesh] > blue[flesh] + 5).mean() > 0.95
    np.testing.assert_array_equal(drawn[~flesh], hands.picture(crop, 2)[~flesh])
    alone = over_crop(np.ones_like(crop), model.capsules(x, np.zeros((1, 3))), uvd, 300.0, NYU, zoom=2)
    assert alone[flesh][:, 1].mean() < 0.6 * drawn[flesh][:, 1].mean()  # less green: red
