"""handpose/synthetic/finder_layer.py, and the net of the finder that learns from it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handpose.estimate.finder import VOTE_MM, channels_of
from handpose.synthetic.finder_layer import HEAT_STEP, IGNORE_LABEL, targets_of
from handpose.synthetic.whole_scenes import SceneGenerator, Scenes
from netlib import TRAIN, Net
from netlib.blob import Array, Blob
from tests.support.running import ROOT


@pytest.fixture(scope="module")
def scenes() -> Scenes:
    """The first block of the seed that the prototxt names."""
    return SceneGenerator(1).block(0)


@pytest.fixture
def net() -> Net:
    return Net(ROOT / "prototxt" / "finder_train_test.prototxt", TRAIN)


def frames_of(block: int) -> Array:
    """The net's input for the scenes of a block."""
    return channels_of(SceneGenerator(1).block(block).depth)


def learned_params(net: Net) -> list[Blob]:
    """All but the running means and variances."""
    return [blob for layer in net.layers if layer.type != "BatchNorm" for blob in layer.blobs]


def test_the_votes_of_a_hand_lead_to_its_middle(scenes: Scenes) -> None:
    """Within 0.01 mm."""
    _, _, vote, is_voter = targets_of(scenes)
    depth = scenes.depth[:, ::HEAT_STEP, ::HEAT_STEP, None]
    slopes = scenes.slopes[:, ::HEAT_STEP, ::HEAT_STEP]
    which = scenes.which[:, ::HEAT_STEP, ::HEAT_STEP]
    points = np.concatenate([slopes * depth, depth], axis=-1)
    targets = points + VOTE_MM * np.moveaxis(vote, 1, -1)
    for n, k in np.argwhere(scenes.present):
        voters = (which[n] == k + 1) & (is_voter[n, 0] > 0)
        error = targets[n, voters] - scenes.middle[n, k]
        assert np.abs(error).max(initial=0) < 0.01


def test_the_heat_is_highest_at_the_middle_of_a_hand(scenes: Scenes) -> None:
    """A doubtful hand near the middle hides it."""
    heat = targets_of(scenes)[1][:, 0]
    for n, k in np.argwhere(scenes.present):
        column, row = np.round(scenes.middle_px[n, k] / HEAT_STEP).astype(int)
        if row < heat.shape[1] and column < heat.shape[2]:
            assert heat[n, row, column] in (1.0, IGNORE_LABEL)


def test_a_restored_layer_continues_with_the_block_of_its_state(net: Net) -> None:
    scenes_layer = net.layers[0]
    net.forward()
    assert_array_equal(net.blobs["frame"].data, frames_of(0))
    assert scenes_layer.state() == {"number": 1}
    scenes_layer.restore({"number": 5})
    net.forward()
    assert_array_equal(net.blobs["frame"].data, frames_of(5))


def test_all_params_have_gradients(net: Net) -> None:
    net.forward()
    net.backward()
    assert all(param.diff.any() for param in learned_params(net))


def test_the_net_is_small(net: Net) -> None:
    """It runs for every frame."""
    assert sum(param.count for param in learned_params(net)) < 800_000
