"""handpose/synthetic/finder_layer.py and the finder's prototxt"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handpose.estimate.finder import VOTE_MM, channels_of
from handpose.synthetic.finder_layer import IGNORE_LABEL, targets_of
from handpose.synthetic.whole_scenes import SCENES_PER_BLOCK, SceneGenerator
from netlib import TRAIN, Net

NET = Path(__file__).parents[3] / "prototxt" / "finder_train_test.prototxt"


def test_votes_lead_to_palms_and_heat_is_highest_there() -> None:
    scenes = SceneGenerator(1).block(0)
    _, heat, vote, own = targets_of(scenes)
    points = (
        np.concatenate([scenes.slopes, np.ones((*scenes.depth.shape, 1))], axis=-1)
        * scenes.depth[..., None]
    )
    reached = points[:, ::4, ::4] + VOTE_MM * np.moveaxis(vote, 1, -1)
    for n, k in np.argwhere(scenes.present):
        pixels = (scenes.which[n, ::4, ::4] == k + 1) & (own[n, 0] > 0)
        np.testing.assert_allclose(
            reached[n][pixels], np.tile(scenes.middle[n, k], (pixels.sum(), 1)), atol=1e-2
        )
        column, row = np.round(scenes.middle_px[n, k] / 4).astype(int)
        if row < heat.shape[2] and column < heat.shape[3]:
            assert heat[n, 0, row, column] in (1.0, IGNORE_LABEL)


def test_the_net_trains_on_the_scenes_of_its_number() -> None:
    net = Net(NET, TRAIN)
    assert sum(blob.count for layer in net.layers for blob in layer.blobs) < 800000
    net.forward()
    net.backward()
    np.testing.assert_array_equal(
        net.blobs["frame"].data, channels_of(SceneGenerator(1).block(0).depth)
    )
    assert len(net.blobs["frame"].data) == SCENES_PER_BLOCK
    assert net.layers[0].state() == {"number": 1}
    net.layers[0].restore({"number": 5})
    net.forward()
    np.testing.assert_array_equal(
        net.blobs["frame"].data, channels_of(SceneGenerator(1).block(5).depth)
    )
    learned = [blob for layer in net.layers if layer.type != "BatchNorm" for blob in layer.blobs]
    assert all(np.abs(blob.diff).max() > 0 for blob in learned)
