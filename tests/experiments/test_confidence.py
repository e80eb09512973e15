"""experiments/confidence.py: weights of the confidence of tracked poses."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.confidence import Poses, fitted, labelled, main, row, tracked
from handpose.body.fingers import Fingers
from handpose.body.model import Surface
from handpose.fit.pose_confidence import CONSTANT, SIGNS, WEIGHTS, Evidence
from handpose.fit.support import Support
from handpose.frames.cameras import ICVL
from handpose.sequences.recordings import SyntheticRecording
from netlib.errors import DataError


def poses(name: str, weights: np.ndarray, constant: float, seed: int, count: int = 400) -> Poses:
    """Entirely visible poses whose errors are those of the weights, but for a factor of exp(0.2) up or down."""
    rng = np.random.default_rng(seed)
    signs = rng.gamma(1.0, 4.0, (count, len(SIGNS)))
    lag = rng.uniform(0, 2, count)
    fit = np.exp(np.log1p(signs) @ weights + constant)
    error = np.sqrt(fit**2 + lag**2 + signs[:, SIGNS.index("before")] ** 2) * np.exp(rng.choice([-0.2, 0.2], count))
    seen, none = np.ones(count), np.zeros(count)
    evidence = Evidence(signs, lag, Support(seen, none, none, none, none), None)
    return Poses(name, evidence, error)


def test_weights_are_found_again():
    """Weights, constant and spread of made errors are found, whatever the length of each recording."""
    weights, constant = np.array([0.3, 0.0, 0.2, 0.1, 0.25, 0.3, 0.1, 0.0, 0.2]), 0.5
    made = [poses("a", weights, constant, seed=1), poses("b", weights, constant, seed=2, count=4000)]
    found, at, spread = fitted(made, shrink=0.0)
    np.testing.assert_allclose(found, weights, atol=0.03)
    assert at == pytest.approx(constant, abs=0.1) and spread == pytest.approx(0.2, abs=0.01)


def test_few_recordings_hardly_move_the_weights():
    """With a strong shrink, the weights in use stay, and the constant alone follows the errors."""
    found, at, _ = fitted([poses("a", WEIGHTS * 1.5, CONSTANT + 1, seed=1)], shrink=100.0)
    np.testing.assert_allclose(found, WEIGHTS, atol=0.01)
    assert at > CONSTANT + 0.9


def test_a_row_of_the_report():
    """Poses, sure ones, the share of these that is wrong, correlation, and mean expected and true error."""
    made = poses("a", WEIGHTS, CONSTANT, seed=3)
    name, count, sure, wrong, correlation, expected, true = row("a", [made], [made.judged(WEIGHTS, CONSTANT)]).split()
    assert (name, count) == ("a", "400") and 0 < int(sure) < 400 and wrong == "0.0%"
    assert float(correlation) > 0.8
    assert float(expected) == pytest.approx(made.judged(WEIGHTS, CONSTANT).error_mm.mean(), abs=0.06)
    assert float(true) == pytest.approx(made.error_mm.mean(), abs=0.06)


@pytest.mark.parametrize("mirrored", [False, True])
def test_poses_of_a_recording(mirrored: bool):
    """Every frame's nearest pose has its own signs; a mirrored recording shows a left hand at the mirrored places."""
    recording = SyntheticRecording("rest", ICVL, rate=5, seconds=0.6, seed=1)
    fingers = Fingers(Surface(recording.header.skeleton))
    labels = np.stack([labelled(fingers, recording.truth(n).hands[0].xyz) for n in range(recording.count)])
    found = tracked(recording, labels, mirrored)
    signs, lags, support, of_fingers = found.evidence
    assert signs.shape == (recording.count, len(SIGNS)) and len(np.unique(signs, axis=0)) == recording.count
    assert found.error_mm.mean() < 25
    assert {len(part) for part in (lags, *support, *of_fingers)} == {recording.count}


@pytest.mark.parametrize(
    ("more", "message"), [(0, "no hand is tracked in any labelled frame"), (1, "labels, 2"), (-1, "labels, 0")]
)
def test_unsuitable_labels(more: int, message: str):
    """A recording of which nothing can be compared is rejected, and so is another number of labels."""
    recording = SyntheticRecording("rest", ICVL, rate=5, seconds=0.2, seed=1)
    with pytest.raises(DataError, match=message):
        tracked(recording, np.full((1 + more, 5, 3, 3), np.nan), mirrored=False)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ("4 21 3", "a.npy: shape (4, 21, 3), expected (frames, 5, 4, 3)"),
        ("", "a.npy: [Errno 2] No such file or directory"),
    ],
)
def test_bad_labels(tmp_path, monkeypatch, capsys, labels, message):
    """Labels of another shape and missing ones end the command with status 1 and a line."""
    monkeypatch.chdir(tmp_path)
    if labels:
        np.save(tmp_path / "a.npy", np.zeros([int(n) for n in labels.split()]))
    assert main(["takes=a.npy"]) == 1
    assert message in capsys.readouterr().err
