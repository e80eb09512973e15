"""The short campaign of kills: some of the file events of every run that writes; campaign.py runs all."""

from __future__ import annotations

import pytest

from tests.faults import campaign, kills
from tests.faults.isolation import Worker

EVERY = 45


@pytest.mark.parametrize("name", kills.NAMES)
def test_killed(worker: Worker, name: str) -> None:
    """A kill loses no data, the next run has a bitwise equal result, and no temporary files remain."""
    first = kills.NAMES.index(name) % EVERY
    assert campaign.failures(worker, "kills", name, range(first, 1000, EVERY)) == []
