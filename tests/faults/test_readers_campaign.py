"""The short campaign over all readers: a damaged file is one line, or is read all the same.

``make faults`` is the long one, with other seeds. A line of a failure says how to run its case alone:
``python -m tests.faults.campaign`` and the options that it begins with.
"""

from __future__ import annotations

import pytest

from tests.faults import campaign, readers
from tests.faults.isolation import Worker

CASES = 24


@pytest.mark.parametrize("name", [reader.name for reader in readers.READERS])
def test_damaged_files(worker: Worker, name: str) -> None:
    """No traceback, no crash, no hang, no wrong result where a checksum could tell; every refusal is one clear line."""
    assert campaign.failures(worker, "readers", name, range(CASES)) == []
