"""Helpers of data set importers: command line, --check, and preparation of splits."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from handpose.datasets import parts
from handpose.datasets.published_frames import Flaw, PreparedSplit, PublishedFrames
from handpose.frames.images import BadFrameError
from netlib import engine
from tools.common.arguments import parser_of, workers
from tools.common.console import DONE, FAILED, duration, guarded, notify, say
from tools.common.progress import fill_folder

MAX_SHOWN = 10  # bad frames of a split that are printed; all are in the file bad_SPLIT.txt
SPLITS = ("train", "test")


@dataclass(frozen=True)
class Importer:
    """A data set that can be imported."""

    root: str  # name of its folder on the command line
    out: Path  # default of --out
    center: str  # annotated joint at the centre of crops, default of --center
    # reports what exists of a split, and its problems
    check: Callable[[Path, str], tuple[list[str], list[Flaw]]]
    # reads a split, optionally with a file of centres
    read: Callable[[Path, str, Path | None], PublishedFrames]


def main(argv: list[str] | None, doc: str | None, importer: Importer) -> int:
    """Run the command of an importer; returns the exit status."""
    return guarded(lambda args: run(args, importer), arguments(argv, doc, importer))


def arguments(argv: list[str] | None, doc: str | None, importer: Importer) -> argparse.Namespace:
    """Parse the command line of an importer; ``center`` is None for the data set's own centres."""
    parser = parser_of(doc)
    parser.add_argument("root", type=Path, metavar=importer.root, help="the data set as published")
    parser.add_argument(
        "--out", type=Path, default=importer.out, help="folder to write to (default: %(default)s)"
    )
    parser.add_argument(
        "--workers",
        type=workers,
        default=engine.available_cpus(),
        metavar="N",
        help="threads (default: one per processor, %(default)s)",
    )
    parser.add_argument(
        "--center",
        default=importer.center,
        metavar=f"{importer.center}|FILE",
        help="crop centres (default: %(default)s)",
    )
    parser.add_argument(
        "--splits", nargs="+", choices=SPLITS, default=list(SPLITS), help="default: both"
    )
    parser.add_argument(
        "--check", action="store_true", help="only report what exists and what is missing"
    )
    parser.add_argument("--strict", action="store_true", help="stop at the first bad frame")
    parser.add_argument(
        "--force", action="store_true", help="rebuild all files, replacing existing ones"
    )
    args = parser.parse_args(argv)
    args.splits = [split for split in SPLITS if split in args.splits]
    args.center = None if args.center == importer.center else args.center
    if args.center is not None and "{split}" not in args.center and len(args.splits) > 1:
        parser.error(
            '--center FILE applies to one split: select it with --splits, or use "{split}" in the name'
        )
    return args


def run(args: argparse.Namespace, importer: Importer) -> int:
    """Check the data set and, without --check, prepare it; returns the exit status.

    Raises NetlibError.
    """
    problems = []
    for split in args.splits:
        found, wrong = importer.check(args.root, split)
        problems += [problem for problem in wrong if problem not in problems]
        for line in found if args.check else ():
            say(line)
    for problem in problems:
        notify(f"{'' if problem.fatal or args.check else 'warning: '}{problem.text}")
    if args.check:
        if not problems:
            say(f"{args.root}: complete")
        return FAILED if problems else DONE
    if any(problem.fatal for problem in problems):
        return FAILED
    frames = [
        importer.read(args.root, split, args.center and Path(args.center.replace("{split}", split)))
        for split in args.splits
    ]
    return _prepare([PreparedSplit(some, args.out, args.force) for some in frames], args)


def _prepare(splits: Sequence[PreparedSplit], args: argparse.Namespace) -> int:
    """Write what is missing of the splits and print a summary. Raises NetlibError."""
    missing = [part for split in splits for part in split.missing]
    begun = time.perf_counter()

    def fill(advance: Callable[[int], None]) -> None:
        for split in splits:
            _write(split, args, advance)

    parts.check_space(
        args.out, [(len(split.frames), split.frames.crops(0, 0)[0].arrays()) for split in splits]
    )
    status = fill_folder(args.out, sum(part.rows for part in missing), fill)
    if status != DONE:
        return status
    for split in splits:
        print(split.report())
    made = sum(split.made for split in splits)
    took = duration(time.perf_counter() - begun)
    say(f"{args.out}: made {made} frames in {took}" if missing else f"{args.out}: all files kept")
    return DONE


def _write(split: PreparedSplit, args: argparse.Namespace, advance: Callable[[int], None]) -> None:
    """Write one split; print its first bad frames, or stop at the first."""
    count = 0

    def on_bad(i: int, error: BadFrameError) -> None:
        nonlocal count
        if args.strict:
            raise error
        count += 1
        if count <= MAX_SHOWN:
            notify(f"{split.frames.split} frame {i}: {error}")

    split.write(args.workers, advance, on_bad)
    if count > MAX_SHOWN:
        notify(f"{split.frames.split}: {count - MAX_SHOWN} more bad frames, see {split.bad}")
    split.write_list()
