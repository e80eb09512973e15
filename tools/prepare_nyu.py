#!/usr/bin/env python3
"""Prepare the NYU hand pose data set: raw frames and labels to the HDF5 files that the nets read.

    python tools/prepare_nyu.py NYU_ROOT --check
    python tools/prepare_nyu.py NYU_ROOT --out data/nyu

NYU_ROOT has the folders train and test (or dataset/train and dataset/test), each with depth_1_0000001.png,
depth_1_0000002.png, ... and joint_data.mat. --check only says what is there and what is missing.

Crops are those of the paper's released system: 128 x 128 about annotated joint 34 (or the --center given),
cube 300 mm, 261 mm from test frame 2440 on, resized by nearest neighbour. Written are train_000.h5, ... of 2,500
frames each, test_000.h5, ..., and the lists train.txt and test.txt. Files that are there and whole are kept, so a
run that was interrupted goes on where it stopped. Bad frames are left out, named and counted.

A --center FILE has one line "u v d" (px, px, mm) for each frame of the split, or is an .npy or .npz file of such
an array; "{split}" in its name stands for train and test.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run as a file: find the packages

from handpose.data import nyu_files
from handpose.data import parts as files
from handpose.data.bad_frames import BadFrameError
from handpose.data.flaws import Flaw
from handpose.data.parts import Part
from handpose.data.preparation import Outcome, parts_of, write_parts
from handpose.data.published_frames import PublishedFrames, statistics
from handpose.facts.nyu import CENTER_JOINT
from netlib import atomic, engine
from netlib.errors import DataError, NetlibError, reason_of
from tools.console import DONE, FAILED, duration, guarded, positive, progress_bar
from tools.stopper import StoppedError, Stopper

FRAMES_PER_FILE = 2500
NAMED = 10  # bad frames of a split that are named on the screen; the file bad_SPLIT.txt names all
SPLITS = ("train", "test")

Check = Callable[[Path, str], tuple[list[str], list[Flaw]]]
Read = Callable[[Path, str, Path | None], PublishedFrames]


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns its exit status."""
    assert __doc__
    args = arguments(argv, __doc__, "NYU_ROOT", Path("data/nyu"), f"joint{CENTER_JOINT}")
    return guarded(lambda: run(args, nyu_files.check_split, nyu_files.read_split, ["NYU", nyu_files.SYNTHETIC]))


def arguments(argv: list[str] | None, doc: str, root: str, out: Path, center: str) -> argparse.Namespace:
    """The command line of an importer; ``args.center`` becomes None for the default centre."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, metavar=root, help="the data set as published")
    parser.add_argument("--out", type=Path, default=out, help="folder to write to (default: %(default)s)")
    cpus = engine.available_cpus()
    parser.add_argument("--workers", type=positive, default=cpus, metavar="N", help="threads (default: %(default)s)")
    parser.add_argument(
        "--center", default=center, metavar=f"{center}|FILE", help="crop centres (default: %(default)s)"
    )
    parser.add_argument("--splits", nargs="+", choices=SPLITS, default=list(SPLITS), help="default: both")
    parser.add_argument("--check", action="store_true", help="only look, and say what is there and what is missing")
    parser.add_argument("--strict", action="store_true", help="stop at the first bad frame")
    parser.add_argument("--force", action="store_true", help="make all files anew, and replace whatever is there")
    args = parser.parse_args(argv)
    args.splits = [split for split in SPLITS if split in args.splits]
    args.center = None if args.center == center else args.center
    if args.center is not None and "{split}" not in args.center and len(args.splits) > 1:
        parser.error('--center FILE is for one split: name it with --splits, or write "{split}" in the name')
    return args


def run(args: argparse.Namespace, check: Check, read: Read, own: Sequence[str]) -> int:
    """Check the data set, and unless that is all, prepare it. Raises NetlibError."""
    problems = []
    for split in args.splits:
        found, wrong = check(args.root, split)
        problems += [problem for problem in wrong if problem not in problems]
        for line in found if args.check else ():
            print(line)
    for problem in problems:
        print(f"{'' if problem.fatal or args.check else 'warning: '}{problem.text}", file=sys.stderr)
    if args.check:
        if not problems:
            print(f"{args.root}: complete")
        return FAILED if problems else DONE
    if any(problem.fatal for problem in problems):
        return FAILED
    splits = [read(args.root, split, _center_file(args.center, split)) for split in args.splits]
    return prepare(splits, args.out, args.workers, args.strict, args.force, own)


def _center_file(center: str | None, split: str) -> Path | None:
    return None if center is None else Path(center.replace("{split}", split))


def prepare(
    splits: Sequence[PublishedFrames], out: Path, workers: int, strict: bool, force: bool, own: Sequence[str]
) -> int:
    """Write what is missing of the splits into the folder ``out``, and tell what was found. Raises NetlibError."""
    parts = {frames.split: parts_of(frames, out, FRAMES_PER_FILE) for frames in splits}
    lists = [out / f"{frames.split}.txt" for frames in splits]
    every = [part for some in parts.values() for part in some]
    if not force:
        files.refuse_foreign([part.path for part in every], lists, own)
    missing = every if force else [part for part in every if not files.is_whole(part)]
    begun = time.perf_counter()
    outcomes: list[Outcome] = []
    try:
        with Stopper() as stopper, contextlib.ExitStack() as stack:
            out.mkdir(parents=True, exist_ok=True)
            files.check_space(out, missing, splits[0].columns())
            bar = progress_bar(sum(part.rows for part in missing), 0, " frames") if missing else None
            if bar:
                stack.callback(bar.close)
            for frames in splits:
                some = parts[frames.split]
                if any(part in missing for part in some):
                    (out / f"{frames.split}.txt").unlink(missing_ok=True)  # no list may name files of two kinds

                def advance(count: int) -> None:
                    if bar:
                        bar.update(count)
                    stopper.check()

                outcomes.append(_write(frames, some, out, workers, strict, force, advance))
    except StoppedError:
        print("stopped; whole files are kept, and the next run goes on after them", file=sys.stderr)
        return 128 + stopper.signum
    except OSError as error:
        raise NetlibError(f"{out}: {reason_of(error)}") from None
    for frames, outcome in zip(splits, outcomes):
        print(_report(frames, outcome))
    made = sum(outcome.made for outcome in outcomes)
    print(f"{out}: made {made} frames in {duration(time.perf_counter() - begun)}" if missing else f"{out}: all kept")
    return DONE


def _write(
    frames: PublishedFrames,
    parts: list[Part],
    out: Path,
    workers: int,
    strict: bool,
    force: bool,
    advance: Callable[[int], None],
) -> Outcome:
    """Write one split with its list, and the names of its bad frames beside."""
    named: list[str] = []

    def on_bad(i: int, error: BadFrameError) -> None:
        if strict:
            raise error
        named.append(f"frame {i}: {error}")
        if len(named) <= NAMED:
            print(f"{frames.split} {named[-1]}", file=sys.stderr)

    outcome = write_parts(frames, parts, workers, advance, on_bad, force)
    bad = out / f"bad_{frames.split}.txt"
    if named:
        atomic.replace_text(bad, "".join(f"{line}\n" for line in named))
    else:
        bad.unlink(missing_ok=True)
    if len(named) > NAMED:
        print(f"{frames.split}: {len(named) - NAMED} more bad frames, see {bad}", file=sys.stderr)
    if not outcome.index:
        raise DataError(f"{frames.files[0].parent}: none of the {len(frames)} {frames.split} frames can be used")
    used = {i // FRAMES_PER_FILE for i in outcome.index}
    some = [part.path for n, part in enumerate(parts) if n in used]  # HDF5Data wants no file without rows
    atomic.replace_text(out / f"{frames.split}.txt", files.list_text(some))
    return outcome


def _report(frames: PublishedFrames, outcome: Outcome) -> str:
    """What became of a split, in one line or two."""
    counts = ", ".join(f"{count} {kind}" for kind, count in sorted(Counter(outcome.bad.values()).items()))
    bad = f", {len(outcome.bad)} bad frames left out: {counts}" if counts else ", none bad"
    head = f"{frames.split}: {len(outcome.index)} frames ({frames.made_from}){bad}"
    return f"{head}\n{frames.split}: {statistics(frames, outcome.index)}"


if __name__ == "__main__":
    sys.exit(main())
