"""The short campaign of commands: one fault for every third one; ``make faults`` runs hundreds for each."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.faults import campaign, commands
from tests.faults.isolation import ROOT, Worker

OTHERS = {
    "docs": "prints", "test_net": "prints", "time": "prints",
    "prepare_icvl": "writes as make_synthetic; runs.py", "prepare_nyu": "writes as make_synthetic; runs.py",
}


@pytest.mark.parametrize("name", commands.NAMES[::5])
def test_commands(worker: Worker, name: str) -> None:
    """A command under a fault ends with a line or its result, changes no other file, and can be run again."""
    number = commands.NAMES.index(name) % len(commands.FAULTS)
    assert campaign.failures(worker, "commands", name, [number]) == []


def test_every_command_has_a_campaign() -> None:
    """A command is in the table of commands.py, or in the exceptions with a reason."""
    known = {command.line.split()[0] for command in commands.COMMANDS} | set(OTHERS)
    assert known == {path.stem for path in Path(ROOT, "tools").glob("*.py")} - {"__init__"}
