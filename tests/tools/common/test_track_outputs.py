"""tools/common/track_outputs.py: all output formats of a track, from synthetic hands."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.output.tracks.json_file import read_track
from handpose.output.tracks.writing import CsvWriter
from handpose.tracking.track import TrackedFrame
from netlib.errors import NetlibError
from tests.support.tracked_hands import HEADER, seen, tracked
from tools.common.track_outputs import Outputs, add_output_options, is_drawn, settle_outputs

ALL = ["--json", "a.json", "--csv", "a.csv", "--sheet", "a.png"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def parsed(*argv: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_output_options(parser)
    return parser.parse_args(argv)


def frames(count: int = 4) -> Iterator[tuple[np.ndarray, TrackedFrame]]:
    """Yield depth images and tracked frames of a hand that moves to the right."""
    for n in range(count):
        hand = tracked(at=(10.0 * n, 0, 600))
        yield seen([hand]), TrackedFrame(n, n / 30, (hand,))


def written(*argv: str, count: int = 4) -> list[str]:
    """Return the names that are reported as written."""
    with Outputs(parsed(*argv), HEADER, 30.0) as outputs:
        for depth, frame in frames(count):
            outputs.write(depth, frame)
    return outputs.written


def test_everything_at_once() -> None:
    """All outputs are complete files, and their names are reported."""
    names = written(*ALL)
    assert sorted(names) == ["a.csv", "a.json", "a.png"] == sorted(p.name for p in Path().iterdir())
    track = read_track("a.json")
    assert not track.cut and [frame.number for frame in track.frames] == [0, 1, 2, 3]
    assert len(Path("a.csv").read_text().splitlines()) == 5
    assert cv2.imread("a.png") is not None


def test_nothing_is_asked() -> None:
    """Without output options nothing is written, unless default names are set from the source."""
    assert written() == [] and list(Path().iterdir()) == []
    parser = argparse.ArgumentParser()
    args = argparse.Namespace(**vars(parsed()), source="takes/wave.bag")
    settle_outputs(args, parser)
    assert (args.json, args.sheet, args.csv, args.video) == ("wave.json", "wave.png", None, None)
    named = argparse.Namespace(**vars(parsed("--csv", "a.csv")), source="takes/wave.bag")
    settle_outputs(named, parser)
    assert named.json is None and named.sheet is None


@pytest.mark.parametrize(
    ("argv", "drawn"),
    [(["--json", "-"], False), (["--csv", "a.csv"], False), (["--sheet", "a.jpg"], True),
     (["--video", "a.mp4"], True)],
)
def test_what_shows_surface(argv: list[str], drawn: bool) -> None:
    assert is_drawn(parsed(*argv)) == drawn


@pytest.mark.parametrize("error", [NetlibError, KeyboardInterrupt])
def test_what_ends_it_keeps_what_was_done(error: type[BaseException]) -> None:
    """After an error or an interruption the files are complete and marked as cut."""
    args = parsed(*ALL)
    with pytest.raises(error), Outputs(args, HEADER, 30.0) as outputs:
        for depth, frame in frames():
            if frame.number == 3:
                raise error
            outputs.write(depth, frame)
    track = read_track("a.json")
    assert track.cut and len(track.frames) == 3
    assert len(Path("a.csv").read_text().splitlines()) == 4
    assert cv2.imread("a.png") is not None and len(outputs.written) == 3


@pytest.mark.parametrize("stopped", [False, True])
def test_one_that_fails_at_the_end(stopped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """If one output fails at the end the others are complete; the first of several errors is raised."""
    end = CsvWriter.__exit__

    def failing(self: CsvWriter, *about: Any) -> None:
        end(self, *about)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(CsvWriter, "__exit__", failing)
    with (
        pytest.raises(OSError, match="No space left"),
        Outputs(parsed(*ALL), HEADER, 30.0) as outputs,
    ):
        for depth, frame in frames():
            outputs.write(depth, frame)
        if stopped:
            raise KeyboardInterrupt
    track = read_track("a.json")
    assert bool(track.cut) == stopped and len(track.frames) == 4
    assert len(Path("a.csv").read_text().splitlines()) == 5 and cv2.imread("a.png") is not None
    with (
        pytest.raises(NetlibError, match=r"^the camera was unplugged$"),
        Outputs(parsed(*ALL), HEADER, 30.0) as outputs,
    ):
        outputs.write(*next(frames()))
        raise NetlibError("the camera was unplugged")
    assert read_track("a.json").cut


def test_no_frames() -> None:
    """Without frames there is no contact sheet; the other files are empty tracks."""
    assert written(*ALL, count=0) == ["a.json", "a.csv"]
    assert not Path("a.png").exists() and read_track("a.json").frames == []


def test_lines_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    """A header and one line per frame are printed at once, and no file name is reported."""
    with Outputs(parsed("--json", "-"), HEADER, 30.0) as outputs:
        for n, (depth, frame) in enumerate(frames()):
            outputs.write(depth, frame)
            lines = capsys.readouterr().out.splitlines()
            assert len(lines) == (2 if n == 0 else 1) and json.loads(lines[-1])["number"] == n
    assert outputs.written == []


def test_a_video() -> None:
    """A video and a contact sheet can be written together."""
    av = pytest.importorskip("av")
    assert set(written("--video", "a.mp4", "--sheet", "a.png")) >= {"a.png"}
    with av.open("a.mp4") as video:
        assert len(list(video.decode(video=0))) == 4
    assert cv2.imread("a.png") is not None


def test_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A missing package is reported before any file is written."""
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(NetlibError, match="is missing: pip install"):
        written(*ALL, "--video", "a.mp4")
    assert list(Path().iterdir()) == []
