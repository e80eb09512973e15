"""The campaign detects failures."""

from __future__ import annotations

import os
import signal

from tests.faults.isolation import Outcome, Worker

HERE = "tests.faults.test_campaign_can_fail"


def case(name: str, seed: int, number: int) -> Outcome:
    """Case for the worker: a failure by name."""
    if name == "traceback":
        return Outcome("read", {}["nothing"])
    if name == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if name == "exit":
        os._exit(3)
    if name == "hang":
        while True:
            signal.pause()
    if name == "memory":
        bytearray(8 << 30)
    return Outcome("held", f"{seed} {number}")


def test_what_goes_wrong_is_one_failure_and_ends_nothing() -> None:
    """The worker continues after an exception, a signal, an exit, an endless loop and exhausted memory."""
    with Worker() as worker:
        found = {}
        for name in ("traceback", "crash", "exit", "memory"):
            found[name] = worker.run(HERE, name, 0, 0)
            assert worker.run(HERE, "good", 4, 5) == Outcome("held", "4 5")
        worker.limit_s = 0.5
        found["hang"] = worker.run(HERE, "hang", 0, 0)
    assert {name: outcome.kind for name, outcome in found.items()} == {
        "traceback": "TRACEBACK", "crash": "CRASH", "exit": "CRASH", "memory": "TRACEBACK", "hang": "HANG",
    }
    assert all(outcome.failed for outcome in found.values())
    assert found["traceback"].detail.startswith("KeyError at tests/faults/test_campaign_can_fail.py:")
    assert found["crash"].detail.startswith("the process ended by SIGSEGV")
    assert found["exit"].detail.startswith("the process ended with status 3")
    assert found["memory"].detail.startswith("MemoryError")
