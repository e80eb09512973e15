"""tools/measure_gestures.py"""

from __future__ import annotations

import json

import pytest

from tests.support.running import run_tool


@pytest.mark.parametrize("options", [[], ["--left"]])
def test_true_joints_are_read_as_shown(options: list[str]) -> None:
    """The true joints of a recording are recognised as the gestures shown."""
    done = run_tool("measure_gestures", "--truth", "--seconds", "6.5", "--seeds", "1", "--json", *options)
    found = json.loads(done.out)
    judged = {name: row for name, row in found["frames"].items() if any(row.values())}
    assert len(judged) >= 2 and found["right"] > 0.95 and found["delay_s"] < 0.2
    assert all(row[name] > 0.9 * sum(row.values()) for name, row in judged.items())


def test_a_table() -> None:
    """The table has a row for each gesture, and a recording too short to judge gives no division by zero."""
    lines = run_tool("measure_gestures", "--seconds", "0.2", "--cameras", "icvl").out.splitlines()
    assert len(lines) == 1 + 8 + 1 and "of 0 frames" in lines[-1]
