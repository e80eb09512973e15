"""The last step of an exercise: train the paper's network for some iterations on newly
rendered frames.
"""

from __future__ import annotations

import contextlib
import functools
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from handpose.synthetic.files import DataSet
from handpose.synthetic.generator import Generator
from netlib import files
from netlib.blob import Array
from netlib.files.paths import ROOT
from netlib.proto import prototxt, schema
from netlib.proto.messages import SolverParameter
from netlib.solver import Solver

# small, as a reader's layer may loop over pixels; the same batch each time, so the loss falls
FRAMES = BATCH = 4
RATE = 'type: "SGD" base_lr: 0.003 momentum: 0.9 lr_policy: "fixed" weight_decay: 0.0005'


@contextlib.contextmanager
def frames() -> Iterator[Path]:
    """Render a few frames as a data set in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="exercise.") as folder:
        DataSet(Path(folder), [(Generator(), FRAMES)]).write(1, lambda count: None)
        yield Path(folder)


def net_text(folder: Path) -> str:
    """Return prototxt/nyu_train_test.prototxt, changed to read small batches of these frames."""
    text = files.read_text(ROOT / "prototxt" / "nyu_train_test.prototxt", "the net")
    text = text.replace("data/nyu/train.txt", str(folder / "train.txt"))
    return text.replace("batch_size: 512", f"batch_size: {BATCH}")


def solver_of(net: str, options: str = RATE, seed: int = 1) -> Solver:
    """Return a solver of a net given as text, on the plain engine, which runs the layer
    classes themselves.
    """
    param = schema.read(prototxt.parse(options, "<exercise>"), SolverParameter, "solver")
    param = schema.changed(
        param, net_param=prototxt.parse(net, "<exercise>"), display=0, max_iter=10**6
    )
    return Solver(param, "<exercise>", seed=seed, engine="plain")


def losses(iterations: int) -> Array:
    """Return the loss of each iteration."""
    with frames() as folder:
        return trained(solver_of(net_text(folder)), iterations)


def trained(solver: Solver, iterations: int) -> Array:
    """Train for a number of iterations; returns the loss of each.

    A terminal shows a dot for each.
    """
    found = []
    for i in range(iterations):
        solver.step(1)
        found.append(solver.net.loss())
        if sys.stderr.isatty():
            print("." * (i + 1), end="\r", file=sys.stderr, flush=True)
    return np.array(found)


@functools.cache
def reference_losses(iterations: int) -> Array:
    """Return the losses with the project's layers."""
    return losses(iterations)
