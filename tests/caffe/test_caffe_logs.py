"""Compare netlib's log of signals with that of real Caffe; test plot_log. tests/tools/test_caffe.py
has whole logs.

Only the text after ``] `` is compared. Three things are not: durations; the losses of
sigint.log, whose training started with Caffe's own random weights; and the lines on how a net is
built, which netlib lacks.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.errors import DataError
from netlib.updates import learning_rate
from tests.caffe.recorded import FOLDER, log_lines, said, same_print, solver_text, words
from tools import plot_log

pytestmark = pytest.mark.both_engines


def solver_of(log: str, tmp_path: Path, **changes: str) -> netlib.Solver:
    """Return the solver of a recorded log, with snapshots in a temporary folder."""
    text = solver_text(log, snapshot_prefix=f'"{tmp_path}/a"', **changes)
    (tmp_path / "solver.prototxt").write_text(text)
    return netlib.get_solver(tmp_path / "solver.prototxt")


def test_signals_are_handled_and_logged_as_in_caffe(
    solvers: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """SIGHUP writes a snapshot and continues, SIGINT writes one and stops, in a hundredth of
    Caffe's iterations.
    """
    caplog.set_level("INFO", "netlib")
    solver = solver_of("sigint.log", tmp_path, display="20", weights='"init.caffemodel.h5"')

    def signals() -> None:
        solver.requested = {177: "snapshot", 304: "stop"}.get(solver.iter)

    solver.on_update.append(signals)
    assert not solver.solve()
    assert "Finetuning from init.caffemodel.h5" in caplog.messages
    mine, theirs = said(caplog.messages), said(log_lines("sigint.log"))[:-1]
    assert [line.replace("/20 iters", "/2000 iters") for line in words(mine)] == words(theirs)
    when = re.compile(r"(?:Iteration |file )(\d+)")
    assert [int(n) for n in when.findall("\n".join(mine))] == [
        int(n) // 100 for n in when.findall("\n".join(theirs))
    ]
    rates = re.findall(r"Iteration (\d+), lr = (\S+)", "\n".join(theirs))
    assert len(rates) == 16
    for iteration, rate in rates:  # Caffe's rate is a float32, in which 0.02 * 0.5^285 is 0
        assert same_print(float(np.float32(learning_rate(solver.param, int(iteration)))), rate)


# Log -> number of losses, the first and the last; number of tests, the first and the last
CURVES = {
    "a_avgloss.log": (7, (0, 2.5937), (18, 1.55806), 5, (0, 2.68399), (20, 2.04981)),
    "a_resume_from8.log": (4, (9, 1.45932), (18, 1.51269), 3, (10, 2.01221), (20, 2.19814)),
    "sigint.log": (16, (0, 6.78667), (30000, 1.43783), 1, (0, 5.53498), (0, 5.53498)),
    "deepmodel_train.log": (51, (0, 1.06503), (50, 0.990677), 3, (0, 1.03682), (50, 1.02335)),
}


@pytest.mark.parametrize("name", CURVES)
def test_plot_log_reads_caffes_trainings(name: str) -> None:
    log = plot_log.read_log(FOLDER / "logs" / name)
    loss, test = (log.pop(plot_log.LOSS), *log.values())
    assert (len(loss), loss[0], loss[-1], len(test), test[0], test[-1]) == CURVES[name]
    text = "\n".join(log_lines(name))
    said_losses = re.findall(r"Iteration (\d+)(?: \(.*\))?, loss = (\S+)", text)
    assert loss == [(int(iteration), float(loss)) for iteration, loss in said_losses]


@pytest.mark.parametrize("name", ["test.log", "time.log"])
def test_plot_log_rejects_logs_of_other_commands(name: str) -> None:
    with pytest.raises(DataError, match="expected a training log"):
        plot_log.read_log(FOLDER / "logs" / name)
