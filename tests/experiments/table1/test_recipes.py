"""experiments/table1/recipes.py"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import pytest

from experiments.table1.recipes import ADAM, PAPER
from netlib.proto import messages, schema
from netlib.proto.prototxt import Message
from netlib.training import solver_parameter
from netlib.updates import learning_rate


def read(tree: Message) -> Any:
    """The solver described by a tree."""
    return schema.read(tree, messages.SolverParameter, "solver")


def test_lengths_grow_by_half() -> None:
    """Lengths grow by half and are whole numbers."""
    assert PAPER.lengths == (4000, 6000, 9000, 13500)
    assert ADAM.lengths == (20000, 30000, 45000, 67500, 101250)
    assert [PAPER.branch(n) for n in (4000, 13500)] == [3600, 12150] and ADAM.branch(20000) == 14000


def test_the_paper_s_is_the_solver_s() -> None:
    """The solvers differ only in their steps: nine tenths at the full rate, the last tenth at a tenth of it."""
    own = {"max_iter": 4000}
    trunk, end = read(PAPER.trunk(own)), read(PAPER.ending(4000, own))
    paper = solver_parameter.read(PAPER.solver)
    assert asdict(end) | {"stepvalue": 0, "max_iter": 0} == asdict(paper) | {
        "stepvalue": 0, "max_iter": 0, "test_iter": (), "test_interval": 0, "snapshot": 0, "snapshot_prefix": "",
        "snapshot_format": end.snapshot_format, "net": paper.net,
    }
    assert learning_rate(trunk, 3599) == learning_rate(end, 3599) == paper.base_lr
    assert learning_rate(end, 3600) == pytest.approx(paper.base_lr / 10)


def test_adam_falls_in_a_straight_line() -> None:
    """The rate falls linearly from the trunk's rate at the branch to 0."""
    end, trunk = read(ADAM.ending(20000, {"max_iter": 20000})), read(ADAM.trunk({"max_iter": 14000}))
    assert learning_rate(trunk, 500) == pytest.approx(0.001) and learning_rate(trunk, 13999) == pytest.approx(0.002)
    rates = [learning_rate(end, i) for i in (14000, 17000, 20000)]
    assert rates == pytest.approx([0.002, 0.001, 0])
