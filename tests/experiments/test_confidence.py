"""experiments/confidence.py, confidence_poses.py: the weights of the confidence of poses."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from experiments.confidence import cells_of, fitted, text_of
from experiments.confidence_poses import (
    Poses,
    evidence_of_track,
    gathered,
    tracked_poses,
    true_labels,
)
from experiments.constants import tracked_labels
from handpose.estimate.finder import FoundHand
from handpose.estimate.packaged import SYNTHETIC_HAND
from handpose.fit.pose_confidence import (
    LOST_MM,
    PACKAGED,
    SIGNS,
    Evidence,
    Judge,
    Regression,
    Regressions,
    finger_signs,
    mean_log_error,
    read_weights,
)
from handpose.fit.settings import FitSettings
from handpose.frames.cameras import ICVL
from handpose.sequences.recordings import SyntheticRecording
from netlib.errors import DataError
from netlib.files.paths import ROOT
from tests.handpose.estimate.conftest import Said
from tests.support.labelled_recordings import write_labelled
from tests.support.running import run_tool

JUDGE = Judge(FitSettings())
IN_USE = read_weights()
MADE = Regressions(
    Regression(np.array([0.3, 0.0, 0.2, 0.1, 0.25, 0.3, 0.2]), 0.5, 0.2),
    Regression(np.array([0.4, 0.2, 0.0, 0.1, 0.5]), 0.3, 0.1),
)


def poses(name: str, weights: Regressions, seed: int, count: int = 400) -> Poses:
    """Visible poses with the errors of these weights, but for a factor up or down by the spread."""
    rng = np.random.default_rng(seed)
    lengths = (rng.gamma(1.0, 4.0, (count, 5)) for _ in range(3))
    evidence = Evidence(
        rng.gamma(1.0, 4.0, (count, len(SIGNS))),
        rng.uniform(0, 2, count),
        np.ones(count),
        *lengths,
        rng.random((count, 5)),
    )
    hand, finger = weights
    log_error = (
        mean_log_error(evidence.signs, evidence.lag_mm, hand)
        + rng.choice([-1, 1], count) * hand.spread
    )
    signs = finger_signs(JUDGE.as_wholes(evidence, hand)[0], evidence)
    off = rng.choice([-1, 1], (count, 5)) * finger.spread
    of_fingers = signs @ finger.weights + finger.constant + off
    return Poses(name, evidence, np.exp(log_error), np.exp(of_fingers))


def test_fitting_recovers_the_true_weights() -> None:
    """The length of a recording does not matter, and places without a hand hardly do."""
    takes = [poses("a", MADE, seed=1), poses("b", MADE, seed=2, count=4000)]
    for found, made, spread in zip(fitted(takes, IN_USE, keep=0.0), MADE, (0.2, 0.1), strict=True):
        assert_allclose(found.weights, made.weights, atol=0.04)
        assert (found.constant, found.spread) == pytest.approx((made.constant, spread), abs=0.12)


def test_weights_are_drawn_towards_those_in_use() -> None:
    """With a strong pull they stay, and the constants alone follow the errors."""
    worse = Regressions(
        *(Regression(1.5 * one.weights, one.constant + 1, one.spread) for one in IN_USE)
    )
    for found, in_use in zip(
        fitted([poses("a", worse, seed=1)], IN_USE, keep=100.0), IN_USE, strict=True
    ):
        assert_allclose(found.weights, in_use.weights, atol=0.01)
        assert found.constant > in_use.constant + 0.9


def test_the_columns() -> None:
    made = poses("a", IN_USE, seed=3)
    made.fingers_mm[:40] = np.nan  # no hands
    made.error_mm[:40] = LOST_MM
    cells = cells_of("a", [made], IN_USE)
    name, count, sure, off, correlation, expected, true, *others = cells.values()
    confidence = JUDGE.judged(made.evidence).confidence[:40]
    assert (name, count, off, *others) == ("a", "360", "0.0%", "40", str((confidence >= 0.3).sum()))
    assert 0 < int(sure) < 360
    judged, error_mm = JUDGE.judged(made.evidence).error_mm[40:], made.error_mm[40:]
    assert float(correlation) == pytest.approx(np.corrcoef(judged, error_mm)[0, 1], abs=0.006)
    assert float(expected) == pytest.approx(judged.mean(), abs=0.06)
    assert float(true) == pytest.approx(error_mm.mean(), abs=0.06)


def test_weights_are_written_and_read(tmp_path: Path) -> None:
    (tmp_path / "w.prototxt").write_text(text_of(MADE, "two\nlines"))
    for found, made in zip(read_weights(tmp_path / "w.prototxt"), MADE, strict=True):
        assert (found.weights.tolist(), found.constant, found.spread) == (
            made.weights.tolist(),
            *made[1:],
        )


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_evidence_gives_the_confidence_that_the_tracker_reports(mirrored: bool) -> None:
    recording = SyntheticRecording("rest", ICVL, rate=5, seconds=0.6, seed=1)
    frames = []
    for frame in tracked_labels(recording, true_labels(recording), 0, mirrored, min_confidence=0):
        frames.append(frame)
        [hand] = frame.hands
        found = JUDGE.judged(evidence_of_track(frame.tracker.track_of(hand), frame.tracker.model))
        assert hand.confidence == pytest.approx(hand.side_confidence * found.confidence[0])
        assert hand.error_mm == pytest.approx(found.error_mm[0])
        assert_allclose(hand.finger_error_mm, found.finger_error_mm[0])
    made = gathered("rest", tracked_poses(iter(frames)))
    assert made.evidence.signs.shape == (recording.count, len(SIGNS)) and made.error_mm.mean() < 25
    assert made.share.sum() == pytest.approx(1)


def test_a_pose_away_from_the_label_counts_as_a_lost_hand() -> None:
    """Its weight is a half."""
    recording = SyntheticRecording("rest", ICVL, rate=5, seconds=0.2, seed=1)
    [frame] = tracked_labels(recording, true_labels(recording), 0, False, min_confidence=0)
    middle, pixels = frame.label.mean(axis=(0, 1)), np.zeros(frame.depth.shape, bool)
    places = (middle + (40, 0, 0), middle + (-200, 0, 0))
    frame.tracker.finder = Said(*(FoundHand(0.9, place, pixels) for place in places))
    found = gathered("rest", tracked_poses(iter([frame])))
    assert len(found.error_mm) == 2 and found.error_mm[0] < 25 and found.error_mm[1] == LOST_MM
    assert np.isnan(found.fingers_mm).any(axis=1).tolist() == [False, True]
    assert found.share == pytest.approx([2 / 3, 1 / 3])


def test_labels_without_a_tracked_hand_are_rejected() -> None:
    recording = SyntheticRecording("rest", ICVL, rate=5, seconds=0.2, seed=1)
    labels = np.full((recording.count, 5, 3, 3), np.nan)
    with pytest.raises(DataError, match="rest: no labelled hand is found in any frame"):
        gathered("rest", tracked_poses(tracked_labels(recording, labels, 0, False)))


def test_the_command_of_the_card(tmp_path: Path) -> None:
    """With a single recording it makes a file of the form of the packaged one, and the
    same file again.
    """
    card = (SYNTHETIC_HAND / "readme.md").read_text(encoding="utf-8").replace("\\\n", " ")
    [line] = [
        line for line in card.splitlines() if line.startswith("python -m experiments confidence")
    ]
    words = shlex.split(line)[3:]
    assert ROOT / words[-1] == PACKAGED and words[-2] == "--out"
    source, labels = write_labelled(tmp_path, frames=2)
    assert words[:2] == ["confidence", "--recording"]
    words[2:-2] = str(source), str(labels)
    texts = []
    for name in ("one", "two"):
        words[-1] = str(tmp_path / f"{name}.prototxt")
        run_tool("experiments.__main__", *words)
        texts.append((tmp_path / f"{name}.prototxt").read_text(encoding="utf-8"))
    assert texts[0] == texts[1]
    made, packaged = (
        [row.split(":")[0] for row in text.splitlines() if row[0] != "#"]
        for text in (texts[0], PACKAGED.read_text())
    )
    assert made == packaged


def test_synthetic_recordings() -> None:
    """Their weights are printed if no file is to be written."""
    words = ["confidence", "--synthetic", "rest", "--cameras", "icvl", "--seconds", "0.2"]
    done = run_tool("experiments.__main__", *words)
    head, *rows = done.out.splitlines()
    assert head.split()[:3] == ["recording", "hands", "sure"]
    assert rows[0].startswith("synthetic rest of icvl, in use")
    assert "hand {" in rows and "finger {" in rows


def test_a_missing_recording_is_a_usage_error() -> None:
    done = run_tool("experiments.__main__ confidence", status=2)
    assert "one of the arguments --recording --synthetic is required" in done.err
    assert done.err.count("\n") == 1
