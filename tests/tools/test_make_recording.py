"""tools/make_recording.py: a recording and its ground truth."""

from __future__ import annotations

import errno
import itertools
import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handpose.frames.cameras import ICVL
from handpose.frames.formats import open_recording
from handpose.frames.writing import _Folder, _Stack
from handpose.output.tracks.json_file import read_track
from handpose.scoring.tracks import score
from handpose.sequences.recordings import SyntheticRecording
from tests.support import json_schema
from tests.support.running import run_tool

SHORT = ["--camera", "icvl", "--seconds", "0.4", "--rate", "10"]

pytestmark = pytest.mark.usefixtures("here")


@pytest.mark.parametrize("name", ["take.npz", "take", "new/folder/take"])
def test_a_recording_and_its_truth(name: str) -> None:
    """The recording equals its generator frame by frame, the truth can be read back, and
    folders are created.
    """
    truth = Path(name).with_name("take.truth.json")
    done = run_tool("make_recording rest", *SHORT, "--seed", "5", "--out", name)
    assert done.out == f"wrote {name}: 4 frames of 0.4 s, unit 1 mm; ground truth in {truth}\n"
    own = SyntheticRecording("rest", ICVL, seconds=0.4, rate=10, seed=5)
    with open_recording(name) as recording:
        for frame, expected in zip(recording, own, strict=True):
            assert_array_equal(frame.depth, expected.depth)
            assert frame.time == pytest.approx(expected.time, abs=1e-5)
        assert recording.camera == ICVL
        assert recording.rate == 10
    track = read_track(truth)
    assert not track.cut
    scores = score(track.header, track.frames, own.truths())
    assert scores.found == 1
    assert scores.hands[0].error_mm < 0.01
    assert np.isnan(scores.hands[0].jitter_mm)


def test_options() -> None:
    """--hand and --clean take effect, and existing files are never replaced."""
    run_tool("make_recording rest", *SHORT, "--hand", "left", "--clean", "--out", "a.npz")
    assert read_track("a.truth.json").frames[0].hands[0].hand == "left"
    assert not json_schema.faults(json.loads(Path("a.truth.json").read_text()))
    first, last = list(open_recording("a.npz"))[:: len(list(open_recording("a.npz"))) - 1]
    assert_array_equal(first.depth, last.depth)
    done = run_tool("make_recording rest", *SHORT, "--out", "a.npz", status=1)
    assert done.err == "a.truth.json: is there already; choose another --out or remove it\n"
    Path("a.truth.json").unlink()
    done = run_tool("make_recording rest", *SHORT, "--out", "a.npz", status=1)
    assert done.err.startswith("a.npz: is there already")
    assert not Path("a.truth.json").exists()


def test_a_recording_that_is_stopped_keeps_whole_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """After an interruption both files are complete up to the same frame."""
    frame = SyntheticRecording.frame

    def interrupted(self: SyntheticRecording, number: int) -> object:
        if number == 2:
            signal.raise_signal(signal.SIGINT)
        return frame(self, number)

    monkeypatch.setattr(SyntheticRecording, "frame", interrupted)
    done = run_tool("make_recording rest", *SHORT, "--out", "a.npz", status=130)
    assert done.err == "stopped; a.npz and a.truth.json have 2 frames\n"
    track = read_track("a.truth.json")
    assert len(list(open_recording("a.npz"))) == len(track.frames) == 2
    assert track.cut


def test_there_is_no_truth_without_a_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(self: _Stack, fresh: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "a.npz")

    monkeypatch.setattr(_Stack, "_fill", failing)
    assert (
        "No space left on device"
        in run_tool("make_recording rest", *SHORT, "--out", "a.npz", status=1).err
    )
    assert not any(Path().iterdir())


def test_a_full_disk_keeps_what_was_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """The frames before it, and their truth."""
    write, calls = _Folder.write, itertools.count()

    def failing(self: _Folder, *frame: Any) -> None:
        if next(calls) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "a")
        write(self, *frame)

    monkeypatch.setattr(_Folder, "write", failing)
    assert (
        "No space left on device"
        in run_tool("make_recording rest", *SHORT, "--out", "a", status=1).err
    )
    track = read_track("a.truth.json")
    assert len(list(open_recording("a"))) == len(track.frames) == 2
    assert track.cut


def test_impossible_outputs_are_rejected() -> None:
    for place in (".", "/", ""):
        done = run_tool("make_recording rest --out", place, status=1)
        assert "expected the name of a new folder or FILE.npz" in done.err
