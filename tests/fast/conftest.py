"""The tests in this folder use the fast engine, regardless of NETLIB_ENGINE."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="module")
def engine_in_use() -> Iterator[None]:
    """Use the fast engine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NETLIB_ENGINE", "fast")
        yield
