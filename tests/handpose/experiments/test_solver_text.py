"""handpose/experiments/solver_text.py"""

from __future__ import annotations

from pathlib import Path

from handpose.experiments.solver_text import with_fields

SOLVER = """net: "a.prototxt"
base_lr: 0.1

test_iter: 3
test_interval: 10
max_iter: 100
snapshot: 50
snapshot_prefix: "a"
"""


def test_own_fields_take_the_place_of_others() -> None:
    """And tests and snapshots go; a path is written as text in quotes."""
    text = with_fields(SOLVER, {"net": Path("b") / "c.prototxt", "max_iter": 7})
    assert text == 'base_lr: 0.1\nnet: "b/c.prototxt"\nmax_iter: 7\n'
