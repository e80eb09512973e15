"""handpose/gestures/over_time.py: hysteresis"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.gestures import over_time
from handpose.gestures.over_time import BEGIN, END, FORGET_S, GestureReader
from handpose.gestures.shapes import GESTURES
from layers.hand.skeleton import load

RATE = 30.0


def read(monkeypatch: pytest.MonkeyPatch, *seen: dict[str, float], ids: list[int] | None = None,
         times: list[float] | None = None) -> list[str]:  # fmt: skip
    """The names that are read where the frames have these scores, 30 a second, of one hand."""
    frames = iter(seen)
    monkeypatch.setattr(over_time, "scores", lambda *_: dict.fromkeys(GESTURES, 0.0) | next(frames))
    reader = GestureReader(load())
    times = times or [i / RATE for i in range(len(seen))]
    return [reader.read(id, "right", np.zeros((31, 3)), time).name for id, time in zip(ids or [0] * len(seen), times)]


def test_one_frame_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame of another gesture, or of none, in between."""
    open_, fist = {"open": 1.0}, {"fist": 1.0}
    assert read(monkeypatch, *[open_] * 5, fist, open_, {}, open_) == ["open"] * 9


def test_a_gesture_that_lasts_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a few frames."""
    found = read(monkeypatch, *[{"open": 1.0}] * 5, *[{"fist": 1.0}] * 8)
    assert found[:5] == ["open"] * 5 and found[-1] == "fist" and found.index("fist") - 5 in (2, 3)


def test_between_the_thresholds_it_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """A doubtful gesture neither begins nor ends."""
    doubtful = {"two": (BEGIN + END) / 2}
    assert read(monkeypatch, *[doubtful] * 20) == [""] * 20
    assert read(monkeypatch, {"two": 1.0}, *[doubtful] * 20) == ["two"] * 21
    assert read(monkeypatch, {"two": 1.0}, *[{"two": END - 0.1}] * 20)[-1] == ""


def test_hands_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each has its own gesture."""
    seen = [{"open": 1.0}, {"fist": 1.0}] * 4
    assert read(monkeypatch, *seen, ids=[0, 1] * 4, times=[i // 2 / RATE for i in range(8)]) == ["open", "fist"] * 4


def test_a_hand_that_was_away_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its old gesture is not kept."""
    away = FORGET_S + 0.1
    assert read(monkeypatch, {"open": 1.0}, {"two": 0.5}, times=[0.0, away]) == ["open", ""]


def test_confidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """That of the gesture; of none, what is left to all gestures."""
    frames = iter([{"open": 0.9}, {"open": 0.2, "fist": 0.3}])
    monkeypatch.setattr(over_time, "scores", lambda *_: dict.fromkeys(GESTURES, 0.0) | next(frames))
    for name, confidence in (("open", 0.9), ("", 0.5)):
        found = GestureReader(load()).read(0, "right", np.zeros((31, 3)), 0.0)
        assert found.name == name and found.confidence == pytest.approx(confidence)
