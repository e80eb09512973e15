"""handpose/tracking/reporting.py: which hands are reported, in tracks, files and live messages."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.body.sides import Side
from handpose.estimate.hand import MIN_CONFIDENCE
from handpose.estimate.predictor import Predictor
from handpose.output.live.messages import Messages
from handpose.output.tracks.writing import open_writer
from handpose.tracking.reporting import SureHands
from handpose.tracking.track import LostHand, PresentHand, TrackedFrame, TrackedHand
from handpose.tracking.tracker import Tracker
from netlib.errors import NetlibError
from tests.handpose.tracking.conftest import Take
from tests.support.tracked_hands import HEADER, tracked


def reported(*frames: tuple[TrackedHand | LostHand, ...], least: float = 0.3) -> list[TrackedFrame]:
    """Frames with these hands, one per second, after the rule."""
    sure = SureHands(least)
    return [sure(TrackedFrame(n, float(n), tuple(one for one in own if isinstance(one, TrackedHand)),
                              tuple(one for one in own if isinstance(one, LostHand))))
            for n, own in enumerate(frames)]


def present(hand: TrackedHand, side: Side | None = "right") -> PresentHand:
    """A hand without its joints."""
    x, y, z = hand.palm_mm.tolist()
    reason = f"the pose is uncertain (confidence {hand.confidence:.0%})"
    return PresentHand(hand.id, side, hand.presence, hand.confidence, (x, y, z), reason)


def test_a_hand_that_becomes_unsure() -> None:
    """It is present, and its joints are given again later; what was found is not changed."""
    sure, unsure = replace(tracked(confidence=0.3), presence=0.8), replace(tracked(confidence=0.299), presence=0.7)
    frames = reported((sure,), (unsure,), (unsure,), (sure,))
    assert [frame.hands for frame in frames] == [(sure,), (), (), (sure,)]
    assert [frame.present for frame in frames] == [(), (present(unsure),), (present(unsure),), ()]
    assert not any(frame.lost for frame in frames)


def test_a_hand_that_was_never_sure() -> None:
    """It is present at the mean of its joints, and is not listed as lost when the tracker loses it."""
    unsure, gone = tracked(confidence=0.1), LostHand(1, "right", 1.0, "hidden")
    first, second = reported((unsure,), (gone,))
    assert not first.hands and first.present[0].place == tuple(unsure.xyz.mean(axis=0))
    assert second == TrackedFrame(1, 1.0, ())


def test_a_hand_that_is_lost_after_it_became_unsure() -> None:
    """The tracker's reason, and the time at which it was there last."""
    *_, last = reported((tracked(),), (tracked(confidence=0.1),), (LostHand(1, "right", 1.0, "left the image"),))
    assert last.lost == (LostHand(1, "right", 1.0, "left the image"),)


def test_the_side_that_was_known() -> None:
    """An unsure hand of an undecided side has the side that it had, if any."""
    undecided = replace(tracked(confidence=0.2), side_confidence=0.6)
    sides = [reported((first,), (undecided,))[1].present[0].hand
             for first in (tracked(), replace(tracked(), side_confidence=0.6))]
    assert sides == ["right", None]


def test_each_hand_by_itself() -> None:
    a, b, c = (tracked(id=id) for id in (0, 1, 2))
    other = present(tracked(id=7))
    sure = SureHands(0.5)
    sure(TrackedFrame(0, 0.0, (a, b, c)))
    unsure = replace(b, confidence=0.4)
    found = sure(TrackedFrame(1, 1.0, (unsure, c), (LostHand(0, "right", 0.0, "x"),), (other,)))
    assert found.hands == (c,) and [one.id for one in found.lost] == [0] and found.present == (other, present(unsure))
    assert sure.frames == 1


def test_a_confidence_that_is_unknown_is_not_below() -> None:
    (frame,) = reported((tracked(confidence=np.nan),), least=1.0)
    assert frame.hands


def test_nothing_is_changed_by_0() -> None:
    frame = TrackedFrame(0, 0.0, (tracked(confidence=0.0),), (LostHand(7, None, 0.0, "hidden"),))
    assert SureHands(0)(frame) is frame


@pytest.mark.parametrize("name", ["min_confidence", "min_presence"])
@pytest.mark.parametrize("least", [-0.1, 1.1, np.nan, "0.3", None])
def test_values_that_are_no_probability(predictor: Predictor, least: Any, name: str) -> None:
    with pytest.raises(NetlibError, match=f"^{name}=.*; expected a number from 0 to 1$"):
        Tracker(predictor, **{name: least})


def test_the_tracker_reports_by_this_rule(predictor: Predictor, shown: Take) -> None:
    """With the default and with a value of its own; the hands are followed as without the rule."""
    confidences = [frame.hands[0].confidence for frame in shown.reported[:12]]
    for least in (None, sorted(confidences)[6]):
        tracker = Tracker(predictor, **({} if least is None else {"min_confidence": least}))
        for frame, same in zip(tracker.follow(shown.frames[:12]), shown.reported):
            (hand,) = same.hands
            enough = hand.confidence >= (MIN_CONFIDENCE if least is None else least)
            assert [one.confidence for one in frame.hands] == [hand.confidence] * enough
            assert len(frame.present) == (not enough)


def test_no_output_has_the_joints(tmp_path: Path) -> None:
    """Files and messages have the reason in their place."""
    frames = reported((tracked(),), (tracked(confidence=0.1),), (tracked(id=2, confidence=0.1),))
    for name in ("t.json", "t.jsonl", "t.csv"):
        with open_writer(tmp_path / name, HEADER) as writer:
            for frame in frames:
                writer.write(frame)
    messages = Messages(HEADER)
    records = [messages.record(frame) for frame in frames]
    written = json.loads((tmp_path / "t.json").read_text())["frames"]
    lines = [json.loads(line) for line in (tmp_path / "t.jsonl").read_text().splitlines()[1:]]
    for every in (written, lines, [json.loads(messages.line(one)) for one in records]):
        without = [[hand["positions_mm"] is None for hand in frame["hands"]] for frame in every]
        assert without == [[False], [True], [True]]
        assert {hand["reason"] for frame in every[1:] for hand in frame["hands"]} == {
            "the pose is uncertain (confidence 10%)"
        }
        [first], [second] = every[1]["hands"], every[2]["hands"]
        assert "angles_rad" not in first and second["palm_mm"] == first["palm_mm"]
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    empty = [{value for key, value in row.items() if key.endswith(("_mm", "_rad"))} == {""} for row in rows]
    assert [row["lost"] for row in rows] == ["", *["the pose is uncertain (confidence 10%)"] * (len(rows) - 1)]
    assert empty == [False, *[True] * (len(rows) - 1)]
