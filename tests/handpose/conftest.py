"""Fixtures shared by the tests of handpose."""

from __future__ import annotations

from pathlib import Path

import pytest

from handpose.fit.body import CapsuleModel
from tests.support.packaged_hand import SKELETON

# real frames, on machines that have them
SHARED = Path(__file__).parents[2].parent / "shared" / "data"


@pytest.fixture
def nyu_data() -> Path:
    """The folder with real NYU frames; the test is skipped where it is missing."""
    if not (SHARED / "nyu").is_dir():
        pytest.skip("needs real NYU frames")
    return SHARED / "nyu"


@pytest.fixture(scope="session")
def model() -> CapsuleModel:
    """The packaged hand, which is fitted by default: capsules, and flat parts between them."""
    return CapsuleModel(SKELETON, 150.0)
