"""docs/making/five_minutes.py: the training of chapter 0, on fewer frames; and its record, which the chapters show."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from docs.making import five_minutes
from docs.making import training as trained
from docs.making.figures.drawn import shows_the_same
from netlib.files.paths import ROOT
from tests.support.running import run_tool

BOOK = ROOT / "docs" / "book"
TOOL = "docs.making.five_minutes"


def test_a_short_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It prints errors before training and after each tenth, which fall on two frames, and writes the picture."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(trained, "BATCH", 8)
    monkeypatch.setattr(five_minutes, "HELD_OUT", 6)
    out = tmp_path / "hands.svg"
    done = run_tool(TOOL, "--frames", "2", "--iterations", "10", "--out", str(out))
    lines = done.out.splitlines()
    errors = [float(re.search(r"training frames +([\d.]+) mm", line)[1]) for line in lines[1:-1]]
    assert lines[0] == "rendering 2 + 6 frames" and lines[-1] == f"wrote {out}"
    assert len(errors) == 11 and errors[-1] < errors[0]
    assert shows_the_same(out.read_bytes(), out.read_bytes())


def test_numbers_that_are_too_small() -> None:
    """No frames and fewer iterations than measurements are usage errors."""
    assert "--frames must be at least 1" in run_tool(TOOL, "--frames", "0", status=2).err
    assert "--iterations at least 10" in run_tool(TOOL, "--iterations", "9", status=2).err


def test_the_first_measurement_is_that_of_the_record() -> None:
    """Before training, the errors of the recorded frames are computed again; they hardly depend on the seed."""
    rendered, held_out = trained.rendered("train", 256), trained.rendered("test", 256)
    for count, points in trained.recorded().runs.items():
        training = trained.Frames(*(array[:count] for array in rendered))
        first = next(trained.learn(training, held_out, trained.ITERATIONS))
        assert first.training_mm == pytest.approx(points[0].training_mm, abs=0.2)
        assert first.held_out_mm == pytest.approx(points[0].held_out_mm, abs=0.2)
        np.testing.assert_allclose(first.shown, points[0].shown, atol=0.02)


def test_chapters_show_what_is_recorded() -> None:
    """Chapter 0 has the output of nano.py, chapters 0 and 7 the errors of both runs."""
    record = trained.recorded()
    beginning, training = ((BOOK / f"{name}.md").read_text(encoding="utf-8") for name in ("0_all_of_it", "7_training"))
    assert "```text\n" + "\n".join(record.nano) + "\n```\n" in beginning
    many, few = ({point.iteration: point for point in record.runs[count]} for count in (trained.FRAMES, trained.FEW))
    errors = [f"{many[iteration].held_out_mm:.0f}" for iteration in (0, 100, 1000)]
    assert "the mean errors are {}, {} and {} mm".format(*errors) in beginning
    for error, place in zip(
        errors, ("of 256 such frames\nis {} mm", "100 iterations it is {} mm", "1,000 iterations it is {} mm")
    ):
        assert place.format(error) in beginning
    assert (
        f"down to {few[1000].training_mm:.0f} mm" in training and f"stays at {few[1000].held_out_mm:.0f} mm" in training
    )
    whole = (BOOK / "10_whole.md").read_text(encoding="utf-8")
    assert f"has an error of {errors[-1]} mm" in whole
    assert abs(few[100].held_out_mm - few[1000].held_out_mm) < 2
    assert f"two errors are {many[1000].training_mm:.0f} and {many[1000].held_out_mm:.0f} mm" in training
