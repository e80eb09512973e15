"""What a track is written as: files of joints and angles, a video, a sheet, Rerun's viewer; all of them at once."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from handpose.drawing.contact_sheets import ContactSheet
from handpose.drawing.rerun_view import RerunView
from handpose.drawing.tracks import Painter
from handpose.drawing.video_file import VideoFile
from handpose.tracks.track import TrackedFrame, TrackHeader
from handpose.tracks.writing import TrackWriter, open_writer
from tools import pictures

FILES = ("json", "csv", "bvh")
DRAWN = ("video", "sheet", "rerun")


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """The options that name what is to be written."""
    parser.add_argument("--json", metavar="FILE|-", type=name_in(".json", ".jsonl", "-"),
                        help="joints, angles, crops: .json, .jsonl (a line per frame, as it comes), or - for such "
                             "lines on standard output")  # fmt: skip
    parser.add_argument("--csv", metavar="FILE.csv", type=name_in(".csv"), help="a row per frame and hand, for tables")
    parser.add_argument("--bvh", metavar="FILE.bvh", type=name_in(".bvh"),
                        help="bones and angles for Blender and others; a file for each hand")  # fmt: skip
    parser.add_argument("--video", metavar="FILE.mp4", type=name_in(".mp4"),
                        help="skeleton and flesh on the depth, hands in space")  # fmt: skip
    parser.add_argument("--sheet", metavar="FILE.png", type=name_in(".png", ".jpg"),
                        help="the whole track on one page")  # fmt: skip
    parser.add_argument("--rerun", metavar="FILE.rrd", nargs="?", const=False, type=name_in(".rrd"),
                        help="Rerun's viewer, or with a name its file")  # fmt: skip


def name_in(*endings: str) -> Callable[[str], str]:
    """Checks a name on the command line: it ends in one of these."""

    def checked(text: str) -> str:
        if Path(text).suffix.lower() not in endings and text not in endings:
            raise argparse.ArgumentTypeError(f"expected a name in {', '.join(endings)}, found {text!r}")
        return text

    return checked


def anything_asked(args: argparse.Namespace) -> bool:
    """Is any output named?"""
    return any(getattr(args, name) is not None for name in (*FILES, *DRAWN))


def is_drawn(args: argparse.Namespace) -> bool:
    """Is anything asked for that shows flesh?"""
    return any(getattr(args, name) is not None for name in DRAWN)


class Outputs:
    """All that the options ask for. Whatever ends its block, what was written stays, as whole files."""

    def __init__(self, args: argparse.Namespace, header: TrackHeader, rate: float | None) -> None:
        self._args = args
        self._painter = Painter(header) if args.video or args.sheet else None
        self._sheet = ContactSheet() if args.sheet else None
        # What is missing for a video or for Rerun is said here, before any file is begun.
        self._video = VideoFile(Path(args.video), rate or 30.0) if args.video else None
        self._view: RerunView | None = None
        if args.rerun is not None:
            self._view = RerunView(header, Path(args.rerun) if args.rerun else None)
        paths = [path for path in (getattr(args, name) for name in FILES) if path is not None]
        self._writers: list[TrackWriter] = [open_writer(path, header, rate) for path in paths]
        self._open = contextlib.ExitStack()
        self.written: list[str] = []

    def __enter__(self) -> Outputs:
        with contextlib.ExitStack() as stack:
            for output in (*self._writers, self._video, self._view):
                if output is not None:
                    stack.enter_context(output)
            self._open = stack.pop_all()
        return self

    def write(self, depth: NDArray[np.float32], frame: TrackedFrame) -> None:
        """Add a frame. Raises NetlibError, OSError."""
        for writer in self._writers:
            writer.write(frame)
        painter = self._painter
        if painter and self._video:
            image = painter.picture(depth, frame)
            self._video.write(image, frame.time)
            if self._sheet:
                self._sheet.add(frame.time, lambda: image)
        elif painter and self._sheet:
            self._sheet.add(frame.time, lambda: painter.seen(depth, frame))
        if self._view:
            self._view.log(depth, frame)

    def __exit__(self, *ended: object) -> None:
        self._open.__exit__(*ended)  # type: ignore[arg-type]
        if self._sheet and self._sheet.times():
            pictures.write_image(self._args.sheet, self._sheet.page())
            self.written.append(self._args.sheet)
        self.written += [str(path) for writer in self._writers for path in writer.files]
        if self._video and self._video.note:
            self.written.append(self._video.note)
        elif self._video and Path(self._args.video).exists():
            self.written.append(self._args.video)
        if self._args.rerun:
            self.written.append(self._args.rerun)
