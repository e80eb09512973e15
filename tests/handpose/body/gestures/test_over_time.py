"""handpose/body/gestures.py: hysteresis"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body import gestures
from handpose.body.gestures import BEGIN, END, FORGET_S, GESTURES, GestureReader
from layers.hand.skeleton import load

RATE = 30.0


def read(monkeypatch: pytest.MonkeyPatch, *seen: dict[str, float], ids: list[int] | None = None,
         times: list[float] | None = None) -> list[str]:
    """The gestures read from one hand's frames with these scores, at 30 frames per second."""
    frames = iter(seen)
    monkeypatch.setattr(gestures, "scores", lambda *_: dict.fromkeys(GESTURES, 0.0) | next(frames))
    reader = GestureReader(load())
    times = times or [i / RATE for i in range(len(seen))]
    return [reader.read(id, "right", np.zeros((31, 3)), time).name for id, time in zip(ids or [0] * len(seen), times)]


def test_one_frame_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A single frame with another gesture, or with none, does not change the result."""
    open_, fist = {"open": 1.0}, {"fist": 1.0}
    assert read(monkeypatch, *[open_] * 5, fist, open_, {}, open_) == ["open"] * 9


def test_a_gesture_that_lasts_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """A new gesture is read after two or three frames."""
    found = read(monkeypatch, *[{"open": 1.0}] * 5, *[{"fist": 1.0}] * 8)
    assert found[:5] == ["open"] * 5 and found[-1] == "fist" and found.index("fist") - 5 in (2, 3)


def test_between_the_thresholds_it_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """A score between the two thresholds neither begins nor ends a gesture."""
    doubtful = {"two": (BEGIN + END) / 2}
    assert read(monkeypatch, *[doubtful] * 20) == [""] * 20
    assert read(monkeypatch, {"two": 1.0}, *[doubtful] * 20) == ["two"] * 21
    assert read(monkeypatch, {"two": 1.0}, *[{"two": END - 0.1}] * 20)[-1] == ""


def test_hands_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each hand has its own gesture."""
    seen = [{"open": 1.0}, {"fist": 1.0}] * 4
    assert read(monkeypatch, *seen, ids=[0, 1] * 4, times=[i // 2 / RATE for i in range(8)]) == ["open", "fist"] * 4


def test_a_hand_that_was_away_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """After an absence the hand's previous gesture is forgotten."""
    away = FORGET_S + 0.1
    assert read(monkeypatch, {"open": 1.0}, {"two": 0.5}, times=[0.0, away]) == ["open", ""]


def test_confidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """The confidence is the gesture's score, or without a gesture what the scores leave of 1."""
    frames = iter([{"open": 0.9}, {"open": 0.2, "fist": 0.3}])
    monkeypatch.setattr(gestures, "scores", lambda *_: dict.fromkeys(GESTURES, 0.0) | next(frames))
    for name, confidence in (("open", 0.9), ("", 0.5)):
        found = GestureReader(load()).read(0, "right", np.zeros((31, 3)), 0.0)
        assert found.name == name and found.confidence == pytest.approx(confidence)
