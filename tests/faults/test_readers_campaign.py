"""The short campaign over all readers: a damaged file is rejected with a one-line error, or read.

campaign.py runs more, with other seeds. The line of a failure starts with the options that run its case
alone with ``python -m tests.faults.campaign``.
"""

from __future__ import annotations

import pytest

from tests.faults import campaign, readers
from tests.faults.isolation import Worker

CASES = 24


@pytest.mark.parametrize("name", [reader.name for reader in readers.READERS])
def test_damaged_files(worker: Worker, name: str) -> None:
    """A damaged file gives a one-line error or a right result, but no traceback, crash or hang."""
    assert campaign.failures(worker, "readers", name, range(CASES)) == []
