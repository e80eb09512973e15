"""The short campaign of signals: some of the forwards and file events of a training run; campaign.py runs all."""

from __future__ import annotations

import pytest

from tests.faults import campaign, signals
from tests.faults.isolation import Worker

EVERY = 12


@pytest.mark.parametrize("name", signals.EVERY_MOMENT)
def test_signals(worker: Worker, name: str) -> None:
    """A signal gives a snapshot, its exit status and a bitwise equal resume, also in the middle of a test."""
    first = signals.EVERY_MOMENT.index(name) % EVERY
    assert campaign.failures(worker, "signals", name, range(first, 1000, EVERY)) == []
