"""What ``nano.py --check`` does: the same updates by nano.py and by netlib."""

from __future__ import annotations

import functools
import sys
from collections.abc import Mapping
from typing import Any

import nano
import numpy as np

ROOT = nano.HAND.parents[2]
sys.path.insert(0, str(ROOT))

import netlib  # noqa: E402
from docs.making.five_minutes import paper_net  # noqa: E402
from netlib.proto import prototxt, schema  # noqa: E402
from netlib.proto.messages import SolverParameter  # noqa: E402

BATCH = 16


class Float64Solver(netlib.Solver):
    """A solver whose net computes in float64."""

    net_class = staticmethod(functools.partial(netlib.Net, dtype=np.float64))


def solver() -> netlib.Solver:
    """The paper's training net and rule, without dropout; its data are set before each update."""
    net = paper_net(BATCH).replace("dropout_ratio: 0.3", "dropout_ratio: 0")
    text = f'base_lr: 0.003 momentum: 0.9 lr_policy: "fixed" net_param {{ {net} }}'
    return Float64Solver(
        schema.read(prototxt.parse(text, "check_nano"), SolverParameter, "check_nano"),
        engine="plain",
    )


def largest_difference(frames: Mapping[str, Any], hand: nano.Skeleton, updates: int = 20) -> float:
    """The largest relative difference between the losses of nano.py and netlib's: same weights,
    batches and updates.
    """
    network, theirs = nano.new_network(np.random.default_rng(1), p=0), solver()
    learned = [
        parameters
        for layer, *parameters in network
        if layer in (nano.convolution, nano.inner_product)
    ]
    for parameters, blobs in zip(learned, theirs.net.params.values(), strict=True):
        for values, blob in zip(parameters, blobs, strict=True):
            blob.data[...] = values
    depth, joints, worst = frames["depth"] / 127, frames["joints"].astype(float), 0.0
    rule = theirs.param  # base_lr and momentum are float32 in a prototxt, as in Caffe
    ours = nano.train(network, hand, depth, joints, updates, BATCH, rule.base_lr, rule.momentum)
    for t, loss in enumerate(ours):
        rows = np.arange(t * BATCH, (t + 1) * BATCH) % len(depth)
        theirs.net.blobs["depth"].data[...] = depth[rows]
        theirs.net.blobs["joint"].data[...] = joints[rows].reshape(BATCH, -1)
        theirs.step(1)
        worst = max(worst, abs(loss / theirs.loss - 1))
    return float(worst)


def report(frames: Mapping[str, Any], hand: nano.Skeleton) -> None:
    """Print the difference."""
    print(
        f"largest relative difference from netlib's losses, 20 updates: {largest_difference(frames, hand):.1e}"
    )
