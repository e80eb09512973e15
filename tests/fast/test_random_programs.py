"""Random operations on random nets: the plain engine and the fast one on 1 and on 4 threads agree after each."""

from __future__ import annotations

import pytest

from tests.fast import random_programs

PER_TEST = 80


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("block", range(3))
def test_the_engines_agree(block: int, caplog: pytest.LogCaptureFixture) -> None:
    """``python -m tests.fast.random_programs SEED`` shows a program that fails."""
    caplog.set_level("ERROR", "netlib")
    for seed in range(block * PER_TEST, (block + 1) * PER_TEST):
        try:
            random_programs.check(seed)
        except AssertionError as error:
            pytest.fail(f"program {seed}: {error}")
