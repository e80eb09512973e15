"""The short campaign of disks and clocks: a few cases of every fault; ``make faults`` runs all."""

from __future__ import annotations

import pytest

from tests.faults import campaign, disks
from tests.faults.isolation import Worker

SHORT = {"clock": range(2), "two trainings": range(2)} | dict.fromkeys(disks.SOAKS, range(1))
STEPS = {"full": 36, "read-only": 40, "one": 44, "limited": 8, "data": 5, "planted": 1}  # else every 24th


@pytest.mark.parametrize("name", disks.NAMES)
def test_disks(worker: Worker, name: str) -> None:
    """A run fails with a one-line error or succeeds, old files stay complete, and the next run succeeds."""
    step = STEPS.get(name.split()[0], 24)
    numbers = SHORT.get(name, range(disks.NAMES.index(name) % step, 1000, step))
    assert campaign.failures(worker, "disks", name, numbers) == []
