"""Outputs of tracking: files of joints and angles, a video, a contact sheet, Rerun's viewer, and a live page."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from handpose import Recording
from handpose.body.joint_formats.formats import FORMAT_NAMES
from handpose.frames import camera_file
from handpose.frames.formats.folder import PICTURES, FolderRecording
from handpose.output.tracks.writing import TrackWriter, open_writer
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib.errors import NetlibError
from tools.common import arguments, outputs
from tools.common.arguments import name_in

if TYPE_CHECKING:  # imported when an output is drawn
    from handpose.output.drawing.rerun_view import RerunView
    from handpose.output.drawing.sheets import ContactSheet
    from handpose.output.drawing.tracks import Painter
    from handpose.output.drawing.video_file import VideoFile
    from tools.common.live_output import LiveOutput

FILES = ("json", "csv", "bvh")
DRAWN = ("video", "sheet", "rerun")
LIVE = ("serve", "udp")
LOCAL = "127.0.0.1"


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that name output files."""
    parser.add_argument("--json", metavar="FILE|-", type=name_in(".json", ".jsonl", "-"),
                        help="joints, angles, crops: .json, .jsonl (one line per frame), or - for such lines on "
                             "standard output")
    parser.add_argument("--csv", metavar="FILE.csv", type=name_in(".csv"), help="one row per frame and hand")
    parser.add_argument("--bvh", metavar="FILE.bvh", type=name_in(".bvh"),
                        help="bones and angles for Blender and other programs; one file per hand")
    parser.add_argument("--joints", choices=FORMAT_NAMES, help="joints of another format and anatomical angles, in "
                        "--json in addition to NYU's, in --csv instead (docs/joint_formats.md)")
    parser.add_argument("--gestures", action="store_true",
                        help="gesture of each hand and its confidence, in --json and --csv")
    parser.add_argument("--video", metavar="FILE.mp4", type=name_in(".mp4"),
                        help="skeleton and surface on the depth image, and hands in space")
    parser.add_argument("--sheet", metavar="FILE.png", type=name_in(".png", ".jpg"),
                        help="contact sheet of the track")
    parser.add_argument("--rerun", metavar="FILE.rrd", nargs="?", const=False, type=name_in(".rrd"),
                        help="show in Rerun's viewer, or write its file")
    add_live_options(parser)
    parser.add_argument("--look", metavar="FILE.png", type=name_in(".png", ".jpg"),
                        help="only report on the first frames, and draw the first hand")


def add_live_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for live output."""
    parser.add_argument("--serve", metavar="HOST:PORT", nargs="?", const=(LOCAL, 0), type=_served,
                        help=f"a page for the browser that shows frames as they come, and JSON lines over WebSocket "
                             f"(default: {LOCAL}, which other machines do not reach, and any free port)")
    parser.add_argument("--addresses", metavar="FILE.json", type=name_in(".json"),
                        help="with --serve: write the addresses, which contain the token, to a file that only you can "
                             "read; removed at the end")
    parser.add_argument(
        "--udp", metavar="HOST:PORT", type=arguments.address(), help="a datagram of JSON per frame to this address"
    )


def _served(text: str) -> tuple[str, int]:
    """Parse HOST:PORT, or a port on the loopback interface."""
    return arguments.address(0)(f"{LOCAL}:{text}" if text.isdigit() else text)


def settle_outputs(args: argparse.Namespace, parser: argparse.ArgumentParser) -> None:
    """Set default outputs if none is given (``args.unnamed``), and reject --look with others."""
    selected = any(getattr(args, name) is not None for name in (*FILES, *DRAWN, *LIVE))
    if args.look is not None and selected:
        parser.error("--look stops after the first frames; omit other outputs")
    if args.addresses is not None and args.serve is None:
        parser.error("--addresses is for --serve")
    args.unnamed = args.look is None and not selected
    if args.unnamed:
        args.json, args.sheet = (f"{_stem(args.source)}{ending}" for ending in (".json", ".png"))
    for option in ("joints", "gestures"):
        if getattr(args, option) and all(getattr(args, name) is None for name in ("json", "csv", *LIVE)):
            parser.error(f"--{option} is for --json, --csv, --serve and --udp; name one of them")


def _stem(source: str) -> str:
    """Stem of default output names; never "camera", as camera.json has another meaning."""
    path = Path(source).absolute()
    name = path.stem.strip("*_-.") or (path if path.is_dir() else path.parent).resolve().name
    name = "".join(c if c.isalnum() or c in "._-" else "_" for c in name) or "track"
    return f"{name}_track" if name == "camera" else name


def refuse_inputs(args: argparse.Namespace, recording: Recording) -> None:
    """Raise NetlibError for an output that replaces an input, an existing file that was not named, or an image in the
    folder of the frames, where it would be taken for a frame.
    """
    source, own = Path(args.source), [args.camera] if isinstance(args.camera, Path) else []
    frames = recording.folder if isinstance(recording, FolderRecording) else None
    inputs = [source, *camera_file.places_next_to(frames or source), *own]
    for name in filter(None, (getattr(args, name) for name in (*FILES, *DRAWN, "look", "addresses"))):
        outputs.refuse_inputs(name, inputs)
        place = Path(os.path.realpath(name))
        if frames and place.suffix.lower() in PICTURES and place.parent == Path(os.path.realpath(frames)):
            raise NetlibError(f"{name}: is in the folder of the frames and would be taken for one; write it elsewhere")
        if args.unnamed and os.path.lexists(name):
            raise NetlibError(f"{name}: exists already; to replace it or to write elsewhere, name the outputs, as in "
                              f"--json {args.json} --sheet {args.sheet}")


def is_drawn(args: argparse.Namespace) -> bool:
    """Whether an output shows the surface of hands."""
    return any(getattr(args, name) is not None for name in (*DRAWN, "serve"))


class Outputs:
    """All outputs that the options select. However the block ends, what was written remains as complete files."""

    def __init__(self, args: argparse.Namespace, header: TrackHeader, rate: float | None) -> None:
        self._args = args
        self._painter: Painter | None = None
        self._sheet: ContactSheet | None = None
        self._video: VideoFile | None = None
        self._view: RerunView | None = None
        if is_drawn(args):
            self._begin_drawing(args, header, rate)
        self._live: LiveOutput | None = None
        if any(getattr(args, name) is not None for name in LIVE):
            from tools.common.live_output import LiveOutput

            self._live = LiveOutput(args, header)
        paths = [path for path in (getattr(args, name) for name in FILES) if path is not None]
        self._writers: list[TrackWriter] = [
            open_writer(path, header, rate, args.joints, args.gestures) for path in paths
        ]
        self._open: list[TrackWriter | VideoFile | RerunView | LiveOutput] = []
        self.written: list[str] = []

    def _begin_drawing(self, args: argparse.Namespace, header: TrackHeader, rate: float | None) -> None:
        """Prepare pictures. Missing packages for video and Rerun are reported here, before any file is started."""
        from handpose.output.drawing.rerun_view import RerunView
        from handpose.output.drawing.sheets import ContactSheet
        from handpose.output.drawing.tracks import Painter
        from handpose.output.drawing.video_file import VideoFile

        if args.video or args.sheet:
            self._painter = Painter(header)
        if args.sheet:
            self._sheet = ContactSheet()
        if args.video:
            self._video = VideoFile(Path(args.video), rate or 30.0)
        if args.rerun is not None:
            self._view = RerunView(header, Path(args.rerun) if args.rerun else None)

    def __enter__(self) -> Outputs:
        for name in filter(None, (self._args.video, self._args.sheet)):  # created later, but checked now
            outputs.check_place(Path(name))
        every = (*self._writers, self._video, self._view, self._live)
        named = [output for output in every if output is not None]
        with contextlib.ExitStack() as stack:
            for output in named:
                stack.enter_context(output)
            stack.pop_all()
        self._open = named
        return self

    def begin(self, recording: Recording, check: Callable[[], None]) -> None:
        """Print the address of the live page, and wait for the first client unless the source is a camera.

        check  called while waiting; raises an error to stop
        """
        if self._live:
            self._live.begin(recording, check, sys.stderr if self._args.json == "-" else sys.stdout)

    @property
    def is_live(self) -> bool:
        """True if frames are sent as they are tracked."""
        return self._live is not None

    def write(self, depth: NDArray[np.float32], frame: TrackedFrame) -> None:
        """Write a frame. Raises NetlibError, OSError."""
        for writer in self._writers:
            writer.write(frame)
        painter = self._painter
        if painter and self._video:
            image = painter.picture(depth, frame)
            self._video.write(image, frame.time)
            if self._sheet:
                self._sheet.add(frame.time, lambda: image[painter.depth_part])
        elif painter and self._sheet:
            self._sheet.add(frame.time, lambda: painter.seen(depth, frame))
        if self._view:
            self._view.log(depth, frame)
        if self._live:
            self._live.write(depth, frame)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        # Each output gets the exception of the block, not failures of other outputs; the first failure is raised.
        failure: Exception | None = error if isinstance(error, (NetlibError, OSError)) else None
        endings: list[Callable[[], None]] = [
            partial(output.__exit__, kind, error, where) for output in reversed(self._open)
        ]
        for end in (*endings, self._write_sheet):
            try:
                end()
            except Exception as one:
                failure = failure or one
        self.written += [str(path) for writer in self._writers for path in writer.files]
        if self._video and self._video.note:
            self.written.append(self._video.note)
        elif self._video and Path(self._args.video).exists():
            self.written.append(self._args.video)
        if self._args.rerun:
            self.written.append(self._args.rerun)
        if failure is not None and failure is not error:
            raise failure

    def _write_sheet(self) -> None:
        if self._sheet and self._sheet.times():
            outputs.write_image(self._args.sheet, self._sheet.page())
            self.written.append(self._args.sheet)
