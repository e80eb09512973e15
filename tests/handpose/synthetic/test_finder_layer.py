"""handpose/synthetic/finder_layer.py, and the net of the finder that learns from it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handpose.estimate.finder import VOTE_MM, channels_of
from handpose.synthetic.finder_layer import IGNORE_LABEL, targets_of
from handpose.synthetic.whole_scenes import SceneGenerator, Scenes
from netlib import TRAIN, Net
from netlib.blob import Array
from tests.support.running import ROOT


@pytest.fixture(scope="module")
def scenes() -> Scenes:
    """The first block of the seed that the prototxt names."""
    return SceneGenerator(1).block(0)


@pytest.fixture
def net() -> Net:
    return Net(ROOT / "prototxt" / "finder_train_test.prototxt", TRAIN)


def frames_of(number: int) -> Array:
    """The net's input for the scenes of a block."""
    return channels_of(SceneGenerator(1).block(number).depth)


def test_the_votes_of_a_hand_lead_to_its_middle(scenes: Scenes) -> None:
    _, _, vote, own = targets_of(scenes)
    depth = scenes.depth[:, ::4, ::4, None]
    points = np.concatenate([scenes.slopes[:, ::4, ::4] * depth, depth], axis=-1)
    reached = points + VOTE_MM * np.moveaxis(vote, 1, -1)
    for n, k in np.argwhere(scenes.present):
        voters = (scenes.which[n, ::4, ::4] == k + 1) & (own[n, 0] > 0)
        off = reached[n][voters] - scenes.middle[n, k]
        assert np.abs(off).max(initial=0) < 0.01


def test_the_heat_is_highest_at_the_middle_of_a_hand(scenes: Scenes) -> None:
    heat = targets_of(scenes)[1][:, 0]
    for n, k in np.argwhere(scenes.present):
        column, row = np.round(scenes.middle_px[n, k] / 4).astype(int)
        if row < heat.shape[1] and column < heat.shape[2]:
            assert heat[n, row, column] in (1.0, IGNORE_LABEL)


def test_a_resume_goes_on_with_the_scenes_of_its_number(net: Net) -> None:
    data = net.layers[0]
    net.forward()
    assert_array_equal(net.blobs["frame"].data, frames_of(0))
    assert data.state() == {"number": 1}
    data.restore({"number": 5})
    net.forward()
    assert_array_equal(net.blobs["frame"].data, frames_of(5))


def test_all_parameters_learn(net: Net) -> None:
    """They are few, because the net runs for every frame."""
    net.forward()
    net.backward()
    learned = [blob for layer in net.layers if layer.type != "BatchNorm" for blob in layer.blobs]
    assert all(blob.diff.any() for blob in learned)
    assert sum(blob.count for blob in learned) < 800_000
