"""Random operations on random nets: the plain engine and the fast one on 1 and on 4 threads agree after each."""

from __future__ import annotations

import logging
import re

import pytest

from fast.batch_norm import FastBatchNorm
from netlib.blob import Blobs
from tests.fast import random_programs

PER_TEST = 80
CANCELLING = (803483, 909045)  # gradients of 1e6 cancel behind a normalization


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("block", range(3))
def test_the_engines_agree(block: int, caplog: pytest.LogCaptureFixture) -> None:
    """The engines agree after every operation.

    ``python -m tests.fast.random_programs --show SEED`` shows a program that fails.
    """
    caplog.set_level("ERROR", "netlib")
    rounded = 0
    for seed in range(block * PER_TEST, (block + 1) * PER_TEST):
        try:
            rounded += random_programs.check(seed).rounded
        except AssertionError as error:
            pytest.fail(f"program {seed}: {error}")
    assert rounded <= 1


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", CANCELLING)
def test_rounding_and_errors(seed: int, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """A difference by rounding, where large gradients cancel, is accepted; a relative error of 1e-6 there is not."""
    caplog.set_level("ERROR", "netlib")
    assert random_programs.check(seed).rounded
    backward = FastBatchNorm.backward

    def wrong(layer: FastBatchNorm, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        backward(layer, top, propagate_down, bottom)
        bottom[0].diff[:1] *= 1 + 1e-6

    monkeypatch.setattr(FastBatchNorm, "backward", wrong)
    with pytest.raises(AssertionError, match=r"differ by .*, rounding by \d"):
        random_programs.check(seed)


def test_the_campaign(capsys: pytest.CaptureFixture[str]) -> None:
    """The campaign prints the numbers of programs and operations and does not log; --show prints one program."""
    level = logging.getLogger("netlib").level
    assert random_programs.main(["--count", "2", "--first", "100000"]) == 0
    assert re.match(r"2 programs, \d+ operations, 0 failed, 0 in which rounding decides", capsys.readouterr().out)
    assert logging.getLogger("netlib").level == level
    assert random_programs.main(["--show", "1"]) == 0
    assert "layer {" in capsys.readouterr().out
