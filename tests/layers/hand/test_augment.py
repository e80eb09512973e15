"""HandAugment: layers/hand/augment.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import netlib
from netlib.errors import LayerError
from tests.support.bad_input import bad_inputs

LAYER = """
layer { name: "in" type: "Input" top: "depth" top: "joint"
        input_param { shape { dim: 40 dim: 1 dim: 128 dim: 128 } shape { dim: 40 dim: 6 } } }
layer { name: "augment" type: "HandAugment" bottom: "depth" bottom: "joint" top: "%s" top: "%s"
        hand_augment_param { %s } }
"""
MIDDLE = 64.75  # px, the centre of a crop
ALL = "rotation: 170 scale: 0.3 shift: 12 depth: 0.3"
NetOf = Callable[..., netlib.Net]


def dots() -> tuple[np.ndarray, np.ndarray]:
    """Crops with two small plates each, and joints at their centres."""
    rng = np.random.default_rng(0)
    depth = np.ones((40, 1, 128, 128), np.float32)
    joint = np.zeros((40, 2, 3), np.float32)
    for n in range(40):
        for k, (x, y) in enumerate(((-0.4, 0.2), (0.3, 0.3))):
            column, row = round(MIDDLE + 64 * x), round(MIDDLE - 64 * y)
            joint[n, k] = (column - MIDDLE) / 64, (MIDDLE - row) / 64, rng.uniform(-0.5, 0.5)
            depth[n, 0, row - 3 : row + 4, column - 3 : column + 4] = joint[n, k, 2]
    return depth, joint.reshape(40, 6)


def augmented(
    net: netlib.Net, depth: np.ndarray, joint: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the tops of the layer for these bottoms."""
    net.blobs["depth"].data[...], net.blobs["joint"].data[...] = depth, joint
    net.forward()
    tops = net.layers[1].spec.top
    return net.blobs[tops[0]].data.copy(), net.blobs[tops[1]].data.copy()


@pytest.mark.parametrize("options", ["rotation: 170", "scale: 0.3", "shift: 12", "depth: 0.3", ALL])
def test_joints_stay_on_the_picture(net_of: NetOf, options: str) -> None:
    """After any change each joint is at the centre of its plate and at its depth."""
    depth, joint = dots()
    y, moved = augmented(net_of(LAYER % ("y", "moved", options)), depth, joint)
    assert np.abs(moved - joint).max() > 0.1
    for n, joints in enumerate(moved.reshape(40, 2, 3).astype(float)):
        for x_, y_, z in joints:
            column, row = MIDDLE + 64 * x_, MIDDLE - 64 * y_
            rows, columns = np.nonzero(np.abs(y[n, 0] - z) < 1e-5)
            assert abs(columns.mean() - column) < 0.6
            assert abs(rows.mean() - row) < 0.6


def test_sizes_of_the_changes(net_of: NetOf) -> None:
    """Each change is uniformly distributed up to its option and equal for both
    joints of an item.
    """
    depth, joint = dots()
    net = net_of(LAYER % ("y", "moved", "shift: 6.4 depth: 0.06"))
    _, moved = augmented(net, depth, joint)
    change = (moved - joint).reshape(40, 2, 3)
    assert_allclose(change[:, 0], change[:, 1], atol=1e-6)
    limits = np.array([0.1, 0.1, 0.06])
    assert (np.abs(change) <= limits + 1e-6).all()
    assert (np.abs(change).max(axis=(0, 1)) > 0.85 * limits).all()
    assert (np.abs(change.mean(axis=(0, 1))) < 0.35 * limits).all()


def test_pixels_are_picked_and_borders_go_on(net_of: NetOf) -> None:
    """Rotation does not interpolate depth, and pixels at the border of the crop are extended."""
    depth = np.ones((40, 1, 128, 128), np.float32)
    depth[:, :, 100:, 50:80] = 0.25
    y, _ = augmented(
        net_of(LAYER % ("y", "moved", "rotation: 20 scale: 0.06 shift: 3")),
        depth,
        np.zeros((40, 6)),
    )
    assert len(np.unique(y[y < 1])) == 40  # one depth per item, that of the plate
    assert (y[:, 0, 127] < 1).any(axis=1).all()


def test_background_stays_and_depth_is_cut(net_of: NetOf) -> None:
    """Background pixels stay 1 for any depth step, and all values stay within [-1, 1]."""
    depth, joint = dots()
    depth[:, :, 60:64, 60:64] = -1
    joint[:, 0] = -1
    y, moved = augmented(net_of(LAYER % ("y", "moved", "depth: 1.2")), depth, joint)
    assert (y[depth == 1] == 1).all()
    for array in (y, moved):
        assert array.min() >= -1
        assert array.max() <= 1


@pytest.mark.parametrize(("options", "phase"), [("", netlib.TRAIN), (ALL, netlib.TEST)])
def test_identity(net_of: NetOf, options: str, phase: int) -> None:
    depth, joint = dots()
    for tops in (("y", "moved"), ("depth", "joint")):
        y, moved = augmented(net_of(LAYER % (*tops, options), phase), depth, joint)
        assert_array_equal(y, depth)
        assert_array_equal(moved, joint)


def test_threads_and_places_change_no_bit(net_of: NetOf, keep_threads: None) -> None:
    results, theirs = [], cv2.getNumThreads()
    for threads, tops in ((1, ("y", "moved")), (4, ("y", "moved")), (2, ("depth", "joint"))):
        netlib.set_threads(threads)
        results.append(augmented(net_of(LAYER % (*tops, ALL)), *dots()))
    assert cv2.getNumThreads() == theirs
    for y, moved in results[1:]:
        assert_array_equal(y, results[0][0])
        assert_array_equal(moved, results[0][1])


def test_every_batch_is_different_and_a_resume_is_exact(net_of: NetOf) -> None:
    net = net_of(LAYER % ("y", "moved", ALL))
    first, _ = augmented(net, *dots())
    state = net.layers[1].state()
    second, _ = augmented(net, *dots())
    assert (first != second).any(axis=(1, 2, 3)).all()
    net.layers[1].restore(state)
    assert_array_equal(augmented(net, *dots())[0], second)


@bad_inputs(
    LayerError,
    {
        "rotation": (
            LAYER % ("y", "moved", "rotation: -5"),
            "net.prototxt:5:30: error: layer 'augment': rotation -5 must be from 0 to 180",
        ),
        "scale": (
            LAYER % ("y", "moved", "scale: 1"),
            "net.prototxt:5:30: error: layer 'augment': scale 1 must be from 0 to 0.9",
        ),
        "no crop": (
            LAYER.replace("dim: 128 }", "dim: 96 }") % ("y", "moved", ""),
            "...: error: layer 'augment': "
            "bottom 'depth' has shape (40, 1, 128, 96), expected crops (N, 1, S, S)",
        ),
        "no joints": (
            LAYER.replace("dim: 6", "dim: 7") % ("y", "moved", ""),
            "net.prototxt:4:7: error: layer 'augment': "
            "bottom 'joint' has shape (40, 7), expected joints (40, 3 K)",
        ),
    },
)
def test_mistakes(net_of: NetOf, given: str, rejected: Any) -> None:
    with rejected:
        net_of(given)


def test_no_gradient(net_of: NetOf) -> None:
    """backward raises an error, because the layer must directly follow the data."""
    layer = net_of(LAYER % ("y", "moved", ALL)).layers[1]
    with pytest.raises(LayerError, match="directly after the data"):
        layer.backward([], [True, False], [])
