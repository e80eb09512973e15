"""Twenty iterations of every solver and learning-rate policy compared with real Caffe."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import netlib
from netlib.updates import learning_rate
from tests.caffe.recorded import Follow, same_print, solver_cases, trajectory

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize("case", solver_cases())
def test_solver_follows_caffe(solvers: Path, caplog: pytest.LogCaptureFixture, case: str) -> None:
    """Weights and loss after each of 20 updates and the learning rates agree with Caffe, also as
    printed in the log.
    """
    caplog.set_level("INFO", "netlib")
    theirs = trajectory(case)
    solver = netlib.get_solver(f"solver_{case}.prototxt", snapshot=0)
    solver.copy_weights("init.caffemodel.h5")
    follow = Follow(solver, theirs)
    solver.step(20)
    # the largest weights: after 3 updates only
    assert (follow.updates, follow.compared) == (20, 5 * 20 + 3)
    assert follow.worst <= 1e-5
    assert follow.worst_loss <= 1e-5
    rates = [learning_rate(solver.param, i) for i in range(20)]
    # printed with six digits
    assert rates == pytest.approx(theirs.printed_rates.tolist(), rel=1e-5)
    log = "\n".join(caplog.messages)
    for what, want in ((r" \(.*\), loss", theirs.printed_losses), (", lr", theirs.printed_rates)):
        said = re.findall(rf"(?m)^Iteration (\d+){what} = (\S+)$", log)
        assert [int(i) for i, _ in said] == list(range(20))
        assert all(same_print(ours, number) for (_, ours), number in zip(said, want))
