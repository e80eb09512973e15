"""The paper's network trained on rendered frames, for chapters 0 and 7: the run, and the record of two runs.

``python -m docs.making.five_minutes`` is the command.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

import netlib
from handpose.synthetic.generator import Generator, Split
from netlib.blob import Array
from netlib.files.paths import ROOT
from netlib.proto import prototxt, schema
from netlib.proto.messages import SolverParameter

RECORD = ROOT / "docs" / "results" / "five_minutes.json"
FRAMES, FEW = 4096, 64
ITERATIONS, BATCH, BLOCK = 1000, 64, 64  # a block of the renderer has 64 frames
CHECKS = 10  # errors are measured at multiples of a tenth of the iterations, and earlier
HELD_OUT = 256
SHOWN = (0, 1, 4, 5)  # held-out frames in the picture
DATA = """
layer { name: "data" type: "Input" top: "depth" top: "joint"
  input_param { shape { dim: %d dim: 1 dim: 128 dim: 128 } shape { dim: %d dim: 93 } } }
"""
RULE = 'type: "Adam" base_lr: 0.0005 momentum: 0.9 momentum2: 0.999 lr_policy: "poly" power: 1 random_seed: 1'


class Frames(NamedTuple):
    """Crops (N, 1, 128, 128), joints (N, 31, 3) in half-cubes, centres (N, 3) in pixels and mm."""

    depth: Array
    joints: Array
    center_uvd: Array


class Point(NamedTuple):
    """What the network can do after some iterations: mean errors in mm, and the joints of the frames to be shown."""

    iteration: int
    training_mm: float
    held_out_mm: float
    shown: list[Any]


def rendered(split: Split, count: int) -> Frames:
    """The first frames of a split."""
    generator = Generator(seed=0, split=split)
    blocks = [generator.block(number) for number in range(-(-count // BLOCK))]
    return Frames(
        np.concatenate([b.depth for b in blocks])[:count],
        np.concatenate([b.joint for b in blocks])[:count].reshape(-1, 31, 3),
        np.concatenate([b.center_uvd for b in blocks])[:count],
    )


def new_solver(iterations: int) -> netlib.Solver:
    """A solver of the paper's training net, whose data are set before each iteration."""
    net = (ROOT / "prototxt" / "nyu_train_test.prototxt").read_text(encoding="utf-8")
    net = re.sub(r'^layer {\n  name: "data".*?^}\n', "", net, flags=re.MULTILINE | re.DOTALL)
    text = f"{RULE} max_iter: {iterations} net_param {{ {DATA % (BATCH, BATCH)} {net} }}"
    return netlib.Solver(schema.read(prototxt.parse(text, "five_minutes"), SolverParameter, "five_minutes"))


def predict(solver: netlib.Solver, depth: Array) -> Array:
    """The joints (N, 31, 3) that the solver's network predicts, without dropout."""
    net = netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST)
    for name, blobs in net.params.items():
        for blob, trained in zip(blobs, solver.net.params[name]):
            blob.data[...] = trained.data
    net.blobs["depth"].reshape(*depth.shape)
    return net.forward(depth=depth)["pred"].reshape(-1, 31, 3)


def error_mm(joints: Array, truth: Array) -> float:
    """The mean distance of the joints from the true ones."""
    return float(150 * np.linalg.norm(joints - truth, axis=2).mean())


def learn(training: Frames, held_out: Frames, iterations: int) -> Iterator[Point]:
    """Train, and measure at the beginning, after a hundredth of the iterations and after each tenth."""
    solver, rng = new_solver(iterations), np.random.default_rng(1)
    order: Array = np.zeros(0, dtype=int)
    measured = {0, iterations // 100, *(iterations * part // CHECKS for part in range(1, CHECKS + 1))}
    for iteration in range(iterations + 1):
        if iteration in measured:
            seen, others = (predict(solver, frames.depth[:HELD_OUT]) for frames in (training, held_out))
            shown = [np.round(others[n], 4).tolist() for n in SHOWN]
            errors = error_mm(seen, training.joints[:HELD_OUT]), error_mm(others, held_out.joints)
            yield Point(iteration, round(errors[0], 1), round(errors[1], 1), shown)
        while len(order) < BATCH:  # every frame once, in a new order
            order = np.concatenate([order, rng.permutation(len(training.depth))])
        rows, order = order[:BATCH], order[BATCH:]
        solver.net.blobs["depth"].data[...] = training.depth[rows]
        solver.net.blobs["joint"].data[...] = training.joints[rows].reshape(BATCH, -1)
        if iteration < iterations:
            solver.step(1)


class Record(NamedTuple):
    """What the documents show: the lines that nano.py prints, and the runs by their number of training frames."""

    nano: list[str]
    runs: dict[int, list[Point]]


@functools.cache
def recorded() -> Record:
    """The record. Raises OSError if it cannot be read."""
    kept = json.loads(RECORD.read_text(encoding="utf-8"))
    return Record(kept["nano"], {int(n): [Point(*point) for point in run] for n, run in kept["runs"].items()})
