"""docs/book/nano.py: the paper in one file computes the same as netlib."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.synthetic.generator import Generator
from tests.test_totals import size_of

BOOK = Path(__file__).resolve().parents[2] / "docs" / "book"
sys.path.insert(0, str(BOOK))

import check_nano  # noqa: E402
import nano  # noqa: E402

COMMAND = [sys.executable, str(BOOK / "nano.py")]


@pytest.fixture(scope="module")
def hand() -> nano.Skeleton:
    return nano.Skeleton(nano.HAND)


def test_it_is_short_and_needs_numpy_alone() -> None:
    """nano.py imports only the standard library and NumPy."""
    text = (BOOK / "nano.py").read_text(encoding="utf-8")
    assert size_of(text).nodes <= 2_000
    imported = set(re.findall(r"^ *(?:import|from) (\w+)", text, re.MULTILINE))
    assert imported - {"check_nano", "numpy"} <= sys.stdlib_module_names


def test_dropout_passes_the_gradient_where_it_passed_the_value(rng: np.random.Generator) -> None:
    """Values and gradients are multiplied by the same mask of 0 and 1 / (1 - p)."""
    y, backward = nano.dropout(np.ones((100, 10)), 0.25, rng)
    assert set(np.unique(y)) == {0, 1 / 0.75}
    assert_array_equal(backward(np.ones((100, 10)))[0], y)


def test_losses_are_those_of_netlib(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """``--check`` compares the losses with netlib's in float64, without dropout: here 2 updates
    instead of 20.
    """
    monkeypatch.setattr(sys, "argv", ["nano.py", "--check"])
    monkeypatch.setattr(check_nano.largest_difference, "__defaults__", (2,))
    runpy.run_path(COMMAND[-1], run_name="__main__")
    text, difference = capsys.readouterr().out.rsplit(" ", 1)
    assert text == "largest relative difference from netlib's losses, 20 updates:"
    assert float(difference) <= 1e-10


def test_errors_and_drawings_are_of_the_joints(hand) -> None:
    """The error is the mean distance in mm; a drawing has the true bones as dots, where the
    predicted ones, o, are not on top of them, and joints beyond the frame at its edge.
    """
    true = nano.hand_model(np.zeros((1, 47)), hand)[0]
    assert nano.error_mm(true + [0.3, 0.4, 0], true) == pytest.approx(75)
    same = nano.drawing(true[0], true[0], hand)
    moved = nano.drawing(true[0] + [5, 0, 0], true[0], hand)
    assert {len(line) for line in same} == {52}
    assert set("".join(same)) == {" ", "o"}
    assert "." in "".join(moved)
    assert all(line[51] == "o" for line in moved if "o" in line)


def test_it_prints_losses() -> None:
    """It prints losses and errors, from update 0 on: those of nearly the hand's initial
    pose, for any seed.
    """
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(COMMAND, stdout=subprocess.PIPE, text=True, env=environment) as running:
        assert running.stdout is not None
        first = running.stdout.readline().split()
        running.kill()
    assert first[:3] == ["update", "0", "loss"]
    assert 7 < float(first[3]) < 9
    assert first[4] == "error"
    assert 90 < float(first[5]) < 98
    assert 95 < float(first[-2]) < 105


def test_frames_are_the_renderers() -> None:
    """The file has the renderer's first training frames, except for a few pixels at edges, which
    rounding decides.
    """
    block = Generator(seed=0, split="train").block(0)
    with np.load(nano.FRAMES) as data:
        assert (data["depth"] != np.rint(block.depth * 127)).mean() <= 1e-3
        assert_allclose(data["joints"], block.joint.reshape(-1, 31, 3), atol=1e-4)
