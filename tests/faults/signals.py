"""Signals at every moment of a training run: it stops with a snapshot, reports it, and resumes with the same result.

A moment is a forward of the training net or of a test net, a file event (in the middle of a snapshot), or a random
time.
"""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

from netlib.net import Net
from tests.faults import readers, runs
from tests.faults.isolation import BrokenPromise, Outcome
from tools import train

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
EVERY_MOMENT = tuple(f"{s.name} at {where}" for where in ("a forward", "a file event") for s in SIGNALS)
RANDOM = tuple(f"{s.name} at a random moment" for s in SIGNALS)
NAMES = EVERY_MOMENT + RANDOM
PAIRS = r"s_iter_\d+\.(caffemodel|solverstate)(\.h5)?"  # names of the pair that a stop writes


def case(name: str, seed: int, number: int) -> Outcome:
    """Send a signal at the moment with this number, and resume the training; over if there are fewer moments."""
    what, where = name.split(" at ")
    wanted = signal.Signals[what]
    before = runs.undisturbed(random.Random(f"{name} {seed} {number}").choice(("training hdf5", "training binary"))
                              if where == "a random moment" else "training hdf5")
    with readers._copied(before.folder):
        if where == "a random moment":
            wait = random.Random(f"{name} {number} {seed}").uniform(0, 0.1)
            begun = runs.Event()
            status, answer = runs.forked(
                lambda: _train(lambda: _at_first_forward(begun.set)), lambda child: _send(child, wanted, begun, wait)
            )
        else:
            arm = _at_forward if where == "a forward" else _at_event
            status, answer = runs.forked(lambda: _train(lambda: arm(number + 1, wanted)))
        if not isinstance(answer, str) and status != -wanted:
            raise BrokenPromise("BROKEN", f"ended with {status}, {answer}")
        if answer is None and not (where == "a random moment" and list(Path().glob("s_iter_6.solverstate*"))):
            raise BrokenPromise("CRASH", f"ended by {what} without a snapshot")
        if answer == "0 no signal":
            return Outcome("over" if where != "a random moment" else "held", "the training was faster")
        said = int(answer.split()[0]) if answer else 0
        if said not in (0, 128 + wanted) or (wanted == signal.SIGHUP and said):
            raise BrokenPromise("UNCLEAR", f"exit status {said} after {what}")
        if said and runs.last_state() is None:
            raise BrokenPromise("LOST", f"no snapshot after {what}")
        runs.finish(before, f"{name} {number + 1}", may_stay=PAIRS)
    return Outcome("held")


_sent = False


def _train(arm: Callable[[], None]) -> str:
    """Run the training tool after calling ``arm``; returns its exit status and whether a signal was received."""
    arm()
    for number in SIGNALS:  # also records a signal after the end
        signal.signal(number, signal.SIG_DFL if number != signal.SIGINT else signal.default_int_handler)
    state = runs.last_state()
    status = train.main(["solver.prototxt", "--seed", "3", *(["--snapshot", str(state)] if state else [])])
    return f"{status} {'a signal' if _sent or status else 'no signal'}"


def _send_here(wanted: signal.Signals) -> None:
    global _sent
    _sent = True
    os.kill(os.getpid(), wanted)


def _at_event(number: int, wanted: signal.Signals) -> None:
    runs.at_events(lambda event, what, path: _send_here(wanted) if event == number else None)


def _at_forward(number: int, wanted: signal.Signals) -> None:
    forward, done = Net.run_forward, 0

    def counted(net: Net) -> float:
        nonlocal done
        done += 1
        if done == number:
            _send_here(wanted)
        return forward(net)

    Net.run_forward = counted  # type: ignore[method-assign]


def _at_first_forward(call: Callable[[], None]) -> None:
    """Call a function at the first forward, when the signal handlers are installed."""
    forward = Net.run_forward

    def told(net: Net) -> float:
        call()
        Net.run_forward = forward  # type: ignore[method-assign]
        return forward(net)

    Net.run_forward = told  # type: ignore[method-assign]


def _send(child: int, wanted: signal.Signals, begun: runs.Event, wait: float) -> None:
    begun.wait()
    time.sleep(wait)  # any moment is right, also after the end
    os.kill(child, wanted)
