"""Fixture shared by the short campaigns: the process that runs their cases."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.faults.isolation import Worker


@pytest.fixture(scope="session")
def worker() -> Iterator[Worker]:
    """A process that runs all cases."""
    with Worker() as worker:
        yield worker
