"""The hand model compared with the released layers, compiled into real Caffe."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from tests.caffe.recorded import relative
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines

HAND = """
    force_backward: true
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 32 dim: 47 } } }
    layer { name: "hand" type: "%s" bottom: "x" top: "y" }
"""


@pytest.mark.parametrize("type_name", ["HandModel", "DeepHandModel"])
@pytest.mark.parametrize(
    ("dtype", "suffix", "tolerance"), [(np.float32, "", 5e-6), (np.float64, "_f64", 1e-12)]
)
def test_hand_model(
    caffe_data: Path,
    net_of: Callable[..., netlib.Net],
    type_name: str,
    dtype: Any,
    suffix: str,
    tolerance: float,
) -> None:
    """Joints and gradients of 32 poses agree with Caffe, under this project's type name and
    the released one.

    Some poses have angles of 900 rad, where neighbouring float32 numbers are 6e-5 rad apart.
    """
    recorded = np.load(caffe_data / "hand_model.npz")
    net = net_of(HAND % type_name, dtype=dtype)
    net.forward(x=recorded["bottom"])
    net.backward(y=recorded["top_diff"])
    usual = (np.abs(recorded["bottom"]) < 7).all(axis=1)
    assert usual.sum() >= 20
    for rows, within in ((slice(None), tolerance), (usual, tolerance / 5)):
        assert relative(net.blobs["y"].data[rows], recorded["top" + suffix][rows]) <= within
        assert relative(net.blobs["x"].diff[rows], recorded["bottom_diff" + suffix][rows]) <= within


@pytest.mark.parametrize(
    "layer", ['"DeepHandModelDofConstraintLoss"', '"PhysLimit" phys_limit_param { norm: L2 }']
)
def test_phys_limit(caffe_data: Path, net_of: Callable[..., netlib.Net], layer: str) -> None:
    """The squared hinge of 64 poses agrees.

    Caffe leaves the diffs of fixed DoFs unwritten; netlib sets them to 0.
    """
    recorded = np.load(caffe_data / "phys_limit.npz")
    net = net_of(
        "force_backward: true "
        + inputs(x=(64, 47))
        + f'layer {{ name: "limit" bottom: "x" top: "loss" type: {layer} }}'
    )
    net.forward(x=recorded["bottom"])
    net.backward()
    free = [*range(6), *range(15, 19), *range(31, 47)]
    assert relative(net.blobs["loss"].data, recorded["loss_w1"]) <= 1e-6
    assert relative(net.blobs["x"].diff[:, free], recorded["bottom_diff_w1"][:, free]) <= 1e-6
    assert not np.delete(net.blobs["x"].diff, free, axis=1).any()
