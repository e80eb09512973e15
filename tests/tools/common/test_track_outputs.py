"""tools/common/track_outputs.py: all output formats of a track, from synthetic hands, and messages
during tracking.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.output.tracks.json_file import read_track
from handpose.output.tracks.writing import TrackWriter
from handpose.tracking.track import TrackedFrame
from netlib.errors import NetlibError
from tests.support.tracked_hands import HEADER, seen, tracked
from tests.tools.conftest import COUNT, ROOT
from tools.common import track_outputs
from tools.common.progress import StoppedError
from tools.common.track_outputs import LiveOutput, Outputs, add_output_options

LONGEST_S = 300  # for which a process is waited
ALL = "--json a.json --csv a.csv --sheet a.png"

pytestmark = pytest.mark.usefixtures("here")


def parsed(options: str = "") -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_output_options(parser)
    return parser.parse_args(options.split())


def frames(count: int = 4) -> Iterator[tuple[np.ndarray, TrackedFrame]]:
    """Yield depth images and tracked frames of a hand that moves to the right."""
    for n in range(count):
        hand = tracked(at=(10.0 * n, 0, 600))
        yield seen([hand]), TrackedFrame(n, n / 30, (hand,))


def written(options: str = "", count: int = 4) -> list[str]:
    """Return the names that are reported as written."""
    with Outputs(parsed(options), HEADER, 30.0) as outputs:
        for depth, frame in frames(count):
            outputs.write(depth, frame)
    return outputs.written


@pytest.mark.parametrize("stopped", [False, True])
def test_all_outputs_are_complete_files_if_one_fails(
    stopped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All outputs are complete files, also if one fails at the end, and marked as cut after
    an interruption.

    The first of several errors is raised.
    """
    end = TrackWriter.__exit__

    def failing(self: TrackWriter, *about: Any) -> None:
        end(self, *about)
        if str(self.path) == "a.csv":
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(TrackWriter, "__exit__", failing)
    with (
        pytest.raises(OSError, match="No space left"),
        Outputs(parsed(ALL), HEADER, 30.0) as outputs,
    ):
        for depth, frame in frames():
            outputs.write(depth, frame)
        if stopped:
            raise KeyboardInterrupt
    track = read_track("a.json")
    assert bool(track.cut) == stopped
    assert len(track.frames) == 4
    assert len(Path("a.csv").read_text().splitlines()) == 5
    assert cv2.imread("a.png") is not None
    assert (
        sorted(outputs.written)
        == ["a.csv", "a.json", "a.png"]
        == sorted(path.name for path in Path().iterdir())
    )
    with (
        pytest.raises(NetlibError, match=r"^the camera was unplugged$"),
        Outputs(parsed(ALL), HEADER, 30.0) as outputs,
    ):
        outputs.write(*next(frames()))
        raise NetlibError("the camera was unplugged")
    assert read_track("a.json").cut


def test_without_outputs_nothing_is_written() -> None:
    assert written() == []
    assert list(Path().iterdir()) == []


def test_no_frames() -> None:
    """Without frames there is no contact sheet; the other files are empty tracks."""
    assert written(ALL, count=0) == ["a.json", "a.csv"]
    assert not Path("a.png").exists()
    assert read_track("a.json").frames == []


def test_lines_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    """A header and one line per frame are printed at once, and no file name is reported."""
    with Outputs(parsed("--json -"), HEADER, 30.0) as outputs:
        for n, (depth, frame) in enumerate(frames()):
            outputs.write(depth, frame)
            lines = capsys.readouterr().out.splitlines()
            assert len(lines) == (2 if n == 0 else 1)
            assert json.loads(lines[-1])["number"] == n
    assert outputs.written == []


def test_a_video() -> None:
    """A video and a contact sheet can be written together."""
    av = pytest.importorskip("av")
    assert set(written("--video a.mp4 --sheet a.png")) >= {"a.png"}
    with av.open("a.mp4") as video:
        assert len(list(video.decode(video=0))) == 4
    assert cv2.imread("a.png") is not None


def test_a_missing_package_is_reported_before_any_file_is_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(NetlibError, match="is missing: pip install"):
        written(f"{ALL} --video a.mp4")
    assert list(Path().iterdir()) == []


# -------------------------------------------------------------------------------------- live output

HAND = tracked()
DEPTH = seen([HAND])


def frame(number: int) -> TrackedFrame:
    return TrackedFrame(number, number / 10, (HAND,))


def source(live: bool) -> Any:
    """Return a stand-in for a camera or a recording."""
    return SimpleNamespace(live=live)


def ends() -> None:
    raise StoppedError


def test_a_port_alone_is_on_the_local_machine() -> None:
    assert parsed("--serve 8000").serve == ("127.0.0.1", 8000)
    assert parsed("--serve 0.0.0.0:0").serve == ("0.0.0.0", 0)
    assert parsed("--serve").serve == ("127.0.0.1", 0)
    assert parsed().serve is None


def test_a_recording_is_no_faster_than_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording's frames are sent at their times, a camera's immediately; a stop request
    ends the wait.
    """
    pytest.importorskip("websockets")
    monkeypatch.setattr(track_outputs.LiveServer, "wait_for_client", lambda self, seconds: True)
    clock = [100.0]
    monkeypatch.setattr(track_outputs.time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(
        track_outputs.time, "sleep", lambda seconds: clock.append(clock.pop() + seconds)
    )
    with LiveOutput(parsed("--serve"), HEADER) as output:
        output.write(DEPTH, frame(50))
        output.begin(source(live=True), ends, sys.stdout)
        output.write(DEPTH, frame(51))
        assert clock == [100.0]
        output.begin(source(live=False), lambda: None, sys.stdout)
        output.write(DEPTH, frame(3))
        assert clock == [pytest.approx(100.3)]
        clock[0] = 105.0
        output.write(DEPTH, frame(4))
        assert clock == [105.0]
        output.begin(source(live=False), ends, sys.stdout)
        with pytest.raises(StoppedError):
            output.write(DEPTH, frame(10_000))


def test_the_addresses_of_the_server_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    """A recording waits for the first client, a camera does not."""
    pytest.importorskip("websockets")
    with LiveOutput(parsed("--serve"), HEADER) as output:
        output.begin(source(live=True), ends, sys.stdout)
        first, second = capsys.readouterr().out.splitlines()
        assert first.startswith("page: http://127.0.0.1:")
        assert second.startswith("for programs: ws://127.0.0.1:")
        with pytest.raises(StoppedError):
            output.begin(source(live=False), ends, sys.stdout)
        assert capsys.readouterr().out.splitlines()[2:] == [
            "waiting for the first connection; Ctrl-C stops"
        ]
        output.write(DEPTH, frame(0))
    with LiveOutput(parsed("--serve 0.0.0.0:0"), HEADER) as output:
        output.begin(source(live=True), ends, sys.stdout)
        assert (
            capsys.readouterr().err
            == "warning: other machines can watch, if they have these addresses\n"
        )


def test_the_addresses_in_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs read the addresses from a file that only the user can read; it is
    removed at the end.
    """
    pytest.importorskip("websockets")
    monkeypatch.setenv(track_outputs.TOKEN, "0123456789abcdefABCDEF-_")
    path = tmp_path / "live.json"
    with LiveOutput(parsed(f"--serve --addresses {path}"), HEADER):
        found = json.loads(path.read_text(encoding="utf-8"))
        assert path.stat().st_mode & 0o777 == 0o600
    assert not path.exists()
    assert found["token"] == "0123456789abcdefABCDEF-_"
    assert found["frames"].startswith("ws://127.0.0.1:")
    assert found["page"].endswith(f"/?token={found['token']}")


# -------------------------------------------------------------------------------- the whole command


@pytest.fixture
def running(recorded: Path, tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """``running("take.npz", "--serve ...")`` starts the tracker as a process, which is killed
    after the test.
    """
    begun: list[subprocess.Popen[str]] = []

    def start(name: str, options: str = "--serve") -> subprocess.Popen[str]:
        command = [
            sys.executable,
            str(ROOT / "tools" / "track.py"),
            str(recorded / name),
            *options.split(),
        ]
        buffered = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        begun.append(subprocess.Popen(command, cwd=tmp_path, env=buffered, **pipes))
        return begun[-1]

    yield start
    for process in begun:
        process.kill()
        process.communicate()


def address_of(process: subprocess.Popen[str]) -> str:
    """The address that a process prints; one that prints none in time is killed, which
    ends the reading.
    """
    assert process.stdout is not None
    limit = threading.Timer(LONGEST_S, process.kill)
    limit.start()
    try:
        for line in process.stdout:
            if line.startswith("for programs: "):
                return line.split()[-1]
    finally:
        limit.cancel()
    raise AssertionError(process.communicate()[1])


def client_of(process: subprocess.Popen[str]) -> contextlib.AbstractContextManager[Any]:
    client = pytest.importorskip("websockets.sync.client")
    return client.connect(address_of(process))


def test_a_program_gets_all_frames_of_a_recording(
    running: Callable[..., subprocess.Popen[str]],
) -> None:
    """Tracking starts when a client connects; it receives the lines of --json up to the end of
    the recording.
    """
    process = running("take.npz", "--serve --json a.jsonl --joints mano")
    with client_of(process) as client:
        header, *frames = (json.loads(line) for line in client)
    out, error = process.communicate(timeout=LONGEST_S)
    assert process.returncode == 0
    assert error == ""
    assert "wrote a.jsonl" in out
    assert header["format"] == "handpose"
    assert header["joint_format"]["name"] == "mano"
    assert [frame["number"] for frame in frames] == list(range(COUNT))
    assert all(
        len(hand["mano"]["positions_m"]) == 21 for frame in frames for hand in frame["hands"]
    )


def test_a_signal_ends_it(running: Callable[..., subprocess.Popen[str]]) -> None:
    """A signal ends the tracker while it waits for a client and while it tracks, with a reason
    sent to clients.
    """
    waiting = running("slow.npz")
    address_of(waiting)
    waiting.send_signal(signal.SIGINT)
    assert waiting.communicate(timeout=LONGEST_S)[1].splitlines()[-1] == "stopped"
    assert waiting.returncode == 130
    tracking = running("slow.npz")
    with client_of(tracking) as client:
        json.loads(client.recv(timeout=LONGEST_S))
        json.loads(client.recv(timeout=LONGEST_S))
        tracking.send_signal(signal.SIGTERM)
        list(client)
    assert tracking.wait(LONGEST_S) == 143
    assert client.protocol.close_reason == "the tracker was stopped"
