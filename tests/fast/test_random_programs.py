"""Random operations on random nets: the plain engine and the fast one on 1 and on 4 threads agree after each."""

from __future__ import annotations

import logging
import re

import pytest

from tests.support import random_programs

PER_TEST = 80


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("block", range(20))
def test_the_engines_agree(block: int, caplog: pytest.LogCaptureFixture) -> None:
    """The engines agree after every operation.

    ``python -m tests.support.random_programs --show SEED`` shows a program that fails.
    """
    caplog.set_level("ERROR", "netlib")
    undecided = 0
    for seed in range(block * PER_TEST, (block + 1) * PER_TEST):
        try:
            random_programs.check(seed)
        except random_programs.UndecidedError:
            undecided += 1
        except AssertionError as error:
            pytest.fail(f"program {seed}: {error}")
    assert undecided <= 1


def test_the_campaign(capsys: pytest.CaptureFixture[str]) -> None:
    """The campaign prints the numbers of programs and operations and does not log; --show prints one program."""
    level = logging.getLogger("netlib").level
    assert random_programs.main(["--count", "2", "--first", "100000"]) == 0
    assert re.match(r"2 programs, \d+ operations, 0 failed, 0 undecided, ", capsys.readouterr().out)
    assert logging.getLogger("netlib").level == level
    assert random_programs.main(["--show", "1"]) == 0
    assert "layer {" in capsys.readouterr().out
