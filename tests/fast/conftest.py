"""These tests are of the fast engine, whatever the process has chosen."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="module")
def engine_in_use() -> Iterator[None]:
    """Fast."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NETLIB_ENGINE", "fast")
        yield
