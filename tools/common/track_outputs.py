"""Outputs of tracking: files of joints and angles, a video, a contact sheet, and live output."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from handpose import Recording
from handpose.body.gestures import GestureReader
from handpose.frames.camera_places import places_next_to
from handpose.frames.formats import PICTURES
from handpose.frames.formats.folder import FolderRecording
from handpose.output.drawing.sheets import ContactSheet
from handpose.output.drawing.tracks import HEAD, Painter
from handpose.output.drawing.video_file import VideoFile
from handpose.output.live.messages import LINES_PATH, VIEWS_PATH, Messages
from handpose.output.live.page import page
from handpose.output.live.server import LiveServer, checked_token
from handpose.output.tracks.writing import TrackWriter, open_writer
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib.errors import NetlibError
from netlib.files import atomic, reading
from netlib.files.paths import real
from tools.common import arguments, outputs
from tools.common.arguments import name_in
from tools.common.console import notify, say
from tools.common.sources import add_joints_option

FILES = ("json", "csv")
DRAWN = ("video", "sheet")
# the outputs that show what an option adds
SHOWN_IN = {"joints": (*FILES, "serve"), "gestures": (*FILES, "serve", *DRAWN)}
LOCAL = "127.0.0.1"
TOKEN = "HANDPOSE_TOKEN"  # environment variable
_CHECK_S = 0.1  # interval between checks for a request to stop


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for output files and live output."""
    parser.add_argument(
        "--json",
        metavar="FILE|-",
        type=name_in(".json", ".jsonl", "-"),
        help="joints, angles, crops: .json, .jsonl (one line per frame), or - for such lines on "
        "standard output",
    )
    parser.add_argument(
        "--csv", metavar="FILE.csv", type=name_in(".csv"), help="one row per frame and hand"
    )
    add_joints_option(parser, "in --json in addition to NYU's, in --csv instead")
    parser.add_argument(
        "--gestures",
        action="store_true",
        help="gesture of each hand, in --json and --csv with its confidence, and in pictures",
    )
    parser.add_argument(
        "--video",
        metavar="FILE.mp4",
        type=name_in(".mp4"),
        help="skeleton and surface on the depth image",
    )
    parser.add_argument(
        "--sheet",
        metavar="FILE.png",
        type=name_in(".png", ".jpg"),
        help="contact sheet of the track",
    )
    parser.add_argument(
        "--serve",
        metavar="HOST:PORT",
        nargs="?",
        const=(LOCAL, 0),
        type=_served,
        help=f"a page for the browser that shows frames as they come, and JSON lines over WebSocket "
        f"(default: {LOCAL}, which other machines do not reach, and any free port)",
    )
    parser.add_argument(
        "--addresses",
        metavar="FILE.json",
        type=name_in(".json"),
        help="with --serve: write the addresses, which contain the token, to a file that only you can "
        "read; removed at the end",
    )
    parser.add_argument(
        "--look",
        metavar="FILE.png",
        type=name_in(".png", ".jpg"),
        help="only report on the first frames, and draw the first hand",
    )


def _served(text: str) -> tuple[str, int]:
    """Parse HOST:PORT, or a port on the loopback interface."""
    return arguments.address(f"{LOCAL}:{text}" if text.isdigit() else text)


def settle_outputs(args: argparse.Namespace, parser: argparse.ArgumentParser) -> None:
    """Set default outputs if none is given (``args.unnamed``), and reject --look with others."""
    selected = _given(args, *FILES, *DRAWN, "serve")
    if args.look is not None and selected:
        parser.error("--look stops after the first frames; omit other outputs")
    if args.addresses is not None and args.serve is None:
        parser.error("--addresses is for --serve")
    args.unnamed = args.look is None and not selected
    if args.unnamed:
        args.json, args.sheet = (f"{_stem(args.source)}{ending}" for ending in (".json", ".png"))
    for option, names in SHOWN_IN.items():
        if getattr(args, option) and not _given(args, *names):
            listed = ", ".join(f"--{name}" for name in names)
            parser.error(f"--{option} is for {listed}; name one of them")


def _stem(source: str) -> str:
    """Stem of default output names; never "camera", as camera.json has another meaning."""
    path = Path(source).absolute()
    name = path.stem.strip("*_-.") or real(path if path.is_dir() else path.parent).name
    name = "".join(c if c.isalnum() or c in "._-" else "_" for c in name) or "track"
    return f"{name}_track" if name == "camera" else name


def refuse_inputs(args: argparse.Namespace, recording: Recording) -> None:
    """Raise NetlibError for an output that replaces an input, an existing file that was not named,
    or an image in the folder of the frames, where it would be taken for a frame.
    """
    source = Path(args.source)
    own = [args.camera] if isinstance(args.camera, Path) else []
    frames = recording.folder if isinstance(recording, FolderRecording) else None
    inputs = [source, *places_next_to(frames or source), *own]
    for name in _given(args, *FILES, *DRAWN, "look", "addresses"):
        outputs.refuse_inputs(name, inputs)
        place = real(name)
        if frames and place.suffix.lower() in PICTURES and place.parent == real(frames):
            raise NetlibError(
                f"{name}: is in the folder of the frames and would be taken for one; write it elsewhere"
            )
        if args.unnamed and os.path.lexists(name):
            raise NetlibError(
                f"{name}: exists already; to replace it or to write elsewhere, name the outputs, as in "
                f"--json {args.json} --sheet {args.sheet}"
            )


def _given(args: argparse.Namespace, *names: str) -> list[Any]:
    """The values of those of the options that are given."""
    return [value for name in names if (value := getattr(args, name)) is not None]


class Outputs:
    """All outputs that the options select.

    However the block ends, what was written remains as complete files.
    """

    def __init__(self, args: argparse.Namespace, header: TrackHeader, rate: float | None) -> None:
        # Missing packages are reported here, before any file is started.
        self._args = args
        self._painter = Painter(header) if args.video or args.sheet else None
        self._gestures = GestureReader(header.skeleton) if args.gestures else None
        self._sheet = ContactSheet() if args.sheet else None
        self._video = VideoFile(Path(args.video), rate or 30.0) if args.video else None
        self._live = LiveOutput(args, header) if args.serve else None
        self._writers: list[TrackWriter] = [
            open_writer(path, header, args.joints, args.gestures) for path in _given(args, *FILES)
        ]
        self._open: list[TrackWriter | VideoFile | LiveOutput] = []
        self.written: list[str] = []

    def __enter__(self) -> Outputs:
        # created later, but checked now
        for name in filter(None, (self._args.video, self._args.sheet)):
            outputs.check_place(name)
        possible = (*self._writers, self._video, self._live)
        named = [output for output in possible if output is not None]
        with contextlib.ExitStack() as stack:
            for output in named:
                stack.enter_context(output)
            stack.pop_all()
        self._open = named
        return self

    def begin(self, recording: Recording, check: Callable[[], None]) -> None:
        """Print the address of the live page, and wait for the first client unless the
        source is a camera.

        check  called while waiting; raises an error to stop
        """
        if self._live:
            self._live.begin(recording, check, sys.stderr if self._args.json == "-" else sys.stdout)

    def write(self, depth: NDArray[np.float32], frame: TrackedFrame) -> None:
        """Write a frame. Raises NetlibError, OSError."""
        if self._gestures is not None:
            frame = frame.with_gestures(self._gestures)
        for writer in self._writers:
            writer.write(frame)
        painter = self._painter
        if painter and self._video:
            image = painter.picture(depth, frame)
            self._video.write(image, frame.time)
            if self._sheet:
                self._sheet.add(frame.time, lambda: image[HEAD:])
        elif painter and self._sheet:
            self._sheet.add(frame.time, lambda: painter.seen(depth, frame))
        if self._live:
            self._live.write(depth, frame)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        # Each output gets the exception of the block, not failures of other outputs; the first
        # failure is raised.
        failure: Exception | None = error if isinstance(error, (NetlibError, OSError)) else None
        endings: list[Callable[[], None]] = [
            partial(output.__exit__, kind, error, where) for output in reversed(self._open)
        ]
        for end in (*endings, self._write_sheet):
            try:
                end()
            except Exception as one:
                failure = failure or one
        self.written += [str(writer.path) for writer in self._writers if writer.path]
        if self._video and Path(self._args.video).exists():
            self.written.append(self._args.video)
        if failure is not None and failure is not error:
            raise failure

    def _write_sheet(self) -> None:
        if self._sheet and self._sheet.times():
            outputs.write_image(self._args.sheet, self._sheet.page())
            self.written.append(self._args.sheet)


class LiveOutput:
    """Sends the frames of a track to the clients of a server. Raises NetlibError."""

    def __init__(self, args: argparse.Namespace, header: TrackHeader) -> None:
        self._messages = Messages(header, args.joints)
        token = checked_token(os.environ[TOKEN], TOKEN) if TOKEN in os.environ else None
        host, port = args.serve
        self._server = LiveServer(host, port, self._messages.header, page(header), token)
        self._addresses = Path(args.addresses) if args.addresses else None
        self._stack = contextlib.ExitStack()
        self._check: Callable[[], None] = lambda: None
        self._begun: float | None = None  # start by time.perf_counter; None for a live camera

    def __enter__(self) -> LiveOutput:
        with contextlib.ExitStack() as stack:
            stack.enter_context(self._server)
            if self._addresses is not None:
                stack.enter_context(_written(self._addresses, self._server))
            self._stack = stack.pop_all()
        return self

    def begin(self, recording: Recording, check: Callable[[], None], file: TextIO | None) -> None:
        """Print the addresses; wait for the first client unless the source is a live camera."""
        self._check = check
        say(f"page: {self._server.page_url}", file=file)
        say(f"for programs: {self._server.lines_url}", file=file)
        if self._server.is_public:
            notify("warning: other machines can watch, if they have these addresses")
        if not recording.live:
            say("waiting for the first connection; Ctrl-C stops", file=file)
        # not file.flush(): it is None if a shell closed standard output
        print(end="", file=file, flush=True)
        while not recording.live and not self._server.wait_for_client(_CHECK_S):
            check()
        if not recording.live:
            self._begun = time.perf_counter()

    def write(self, depth: NDArray[np.floating], frame: TrackedFrame) -> None:
        """Send a frame; frames of a recording are sent in real time."""
        self._wait_until(frame.time)
        has_lines, has_views = map(self._server.has_clients, (LINES_PATH, VIEWS_PATH))
        if not (has_lines or has_views):
            return
        record = self._messages.record(frame)
        if has_lines:
            self._server.put(LINES_PATH, self._messages.line(record))
        if has_views:
            self._server.put(VIEWS_PATH, self._messages.view(record, depth, frame))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, where)

    def _wait_until(self, seconds: float) -> None:
        while (
            self._begun is not None and (early := self._begun + seconds - time.perf_counter()) > 0
        ):
            time.sleep(min(early, _CHECK_S))
            self._check()


@contextlib.contextmanager
def _written(path: Path, server: LiveServer) -> Iterator[None]:
    """A file with the addresses of a server within the block. Raises NetlibError."""
    addresses = {"page": server.page_url, "frames": server.lines_url, "token": server.token}
    with (
        reading.refused(path, "the addresses", NetlibError, "write"),
        atomic.replacing(path) as fresh,
    ):
        fresh.chmod(0o600)
        fresh.write_text(json.dumps(addresses, indent=1) + "\n", encoding="utf-8")
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
