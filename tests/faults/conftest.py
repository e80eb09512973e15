"""What the short campaigns share: the process that takes their cases."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.faults.isolation import Worker


@pytest.fixture(scope="session")
def worker() -> Iterator[Worker]:
    """A process that takes all the cases."""
    with Worker() as worker:
        yield worker
