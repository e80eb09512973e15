"""SIGKILL at every file event of every run: no data are lost, and the next run has the same result as without it."""

from __future__ import annotations

import os
import signal

from tests.faults import readers, runs
from tests.faults.isolation import BrokenPromise, Outcome

NAMES = tuple(run.name for run in runs.RUNS)


def case(name: str, seed: int, number: int) -> Outcome:
    """Kill the run before its file event ``number`` (from 0 on), and run again; over if it has fewer events."""
    before = runs.undisturbed(name)

    def kill(event: int, what: str, path: str | None) -> None:
        if event == number + 1:
            os.kill(os.getpid(), signal.SIGKILL)

    def killed() -> None:
        runs.at_events(kill)
        before.run.run()

    with readers._copied(before.folder):
        status, answer = runs.forked(killed)
        if status == 0:
            return Outcome("over")
        if status != -signal.SIGKILL:
            raise BrokenPromise("BROKEN", f"ended with {status}, {answer}, before the kill")
        runs.finish(before, f"a kill at file event {number + 1}")
    return Outcome("held")
