"""The short campaign of disks and clocks: a few cases of every fault except long soaks; campaign.py runs all."""

from __future__ import annotations

import pytest

from tests.faults import campaign, disks
from tests.faults.isolation import Worker

SHORT = {"clock": range(2), "two trainings": range(1), "soak": range(1)}
LONG = set(disks.SOAKS) - set(SHORT)  # seconds each
STEPS = {"full": 90, "read-only": 100, "one": 110, "limited": 16, "data": 5, "planted": 2}  # else every 36th


@pytest.mark.parametrize("name", [name for name in disks.NAMES if name not in LONG])
def test_disks(worker: Worker, name: str) -> None:
    """A run fails with a one-line error or succeeds, old files stay complete, and the next run succeeds."""
    step = STEPS.get(name.split()[0], 36)
    numbers = SHORT.get(name, range(disks.NAMES.index(name) % step, 1000, step))
    assert campaign.failures(worker, "disks", name, numbers) == []
