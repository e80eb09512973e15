"""The two recipes for training the networks of Table 1, each for any number of iterations.

A training of N iterations is a trunk with a constant rate and an end with a decreasing rate:

    paper   the solver of nyu_solver.prototxt: a tenth of the rate for the last tenth
    adam    that of synthetic_solver.prototxt: linearly to 0 for the last 30%

The trunk does not depend on N, so training runs of several lengths share it: it continues where the last end branched
off. Each length is 1.5 times the one before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from experiments.table1.networks import PROTOTXT
from netlib.proto import prototxt
from netlib.proto.prototxt import Message, Scalar
from netlib.training import solver_parameter

GROWTH = Fraction(3, 2)  # ratio of a length to the one before


@dataclass(frozen=True)
class Recipe:
    """A solver, and its changes to a net.

    solver   its file
    lengths  of the training runs, in iterations, ascending
    end      the fraction of the iterations with a decreasing rate
    batch    frames
    every    iterations from one snapshot to the next
    robust   SmoothL1Loss, no dropout, FC2 filled by xavier, as in synthetic_train_test.prototxt
    """

    name: str
    title: str
    solver: Path
    lengths: tuple[int, ...]
    end: Fraction
    batch: int
    every: int
    robust: bool = False

    def branch(self, iterations: int) -> int:
        """The iteration at which the end of a training run begins; an end has one iteration at least."""
        return iterations - max(1, int(iterations * self.end))

    def trunk(self, own: Mapping[str, object]) -> Message:
        """The tree of the trunk's solver, with the fields ``own``."""
        return with_fields(prototxt.parse_file(self.solver), {"lr_policy": '"fixed"', **own})

    def ending(self, iterations: int, own: Mapping[str, object]) -> Message:
        """The tree of the solver of the end of a training run."""
        begin = self.branch(iterations)
        if not self.robust:
            return with_fields(prototxt.parse_file(self.solver), {"stepvalue": begin, **own})
        # poly falls from base_lr at iteration 0 to 0 at max_iter: where the end begins, it is at the trunk's rate
        rate = solver_parameter.read(self.solver).base_lr / (1 - begin / iterations)
        return with_fields(prototxt.parse_file(self.solver), {"base_lr": rate, "rampup_interval": 0, **own})


def lengths(base: int, count: int) -> tuple[int, ...]:
    """``count`` lengths from ``base`` on, each ``GROWTH`` times the one before, rounded down."""
    return tuple(int(base * GROWTH**k) for k in range(count))


# At the paper's rate errors fall for very long. The longest is beyond the 10,000 of the solver's file.
PAPER = Recipe("paper", "the paper's solver", PROTOTXT / "nyu_solver.prototxt", lengths(4000, 4), Fraction(1, 10),
               batch=512, every=1000)
ADAM = Recipe("adam", "our recipe", PROTOTXT / "synthetic_solver.prototxt", lengths(20000, 5), Fraction(3, 10),
              batch=64, every=5000, robust=True)
RECIPES = {recipe.name: recipe for recipe in (ADAM, PAPER)}  # our recipe converges earlier


def with_fields(solver: Message, own: Mapping[str, object]) -> Message:
    """The tree of a solver with the fields ``own``, without tests and snapshots; its ``str`` is a prototxt.

    A value is a path, or prototxt text: ``'"fixed"'`` is a string, ``"HDF5"`` a word. Raises PrototxtError.
    """
    kept = [f for f in solver.fields if not f.name.startswith(("test_", "snapshot")) and f.name not in own]
    written = {
        name: Scalar("string", value.as_posix(), solver.position) if isinstance(value, Path) else value
        for name, value in own.items()
    }
    added = prototxt.parse("\n".join(f"{name}: {value}" for name, value in written.items())).fields
    return Message([*kept, *added], solver.position)
