"""Make synthetic training and test data: depth crops of random hands with their joints.

    python tools/make_synthetic.py --out data/nyu --train 20000 --test 2000

writes train_000.h5, train_001.h5, ... of 2,500 frames each, test_000.h5, and the lists train.txt and test.txt
that HDF5Data layers read. What is already there and the same is kept, so a second run returns at once and a
run that was interrupted goes on where it stopped. Data not made by this tool is left alone without --force.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import os
import re
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run as a file: find the packages

from handpose.synthetic import Generator, Split, empty_frames, generate, processes
from netlib.errors import NetlibError, os_reason
from tools.console import duration, guarded, progress_bar

FRAMES_PER_FILE = 2500
BYTES_PER_FRAME = 67_000  # somewhat more than it takes
MADE_FROM = "synthetic"
DESCRIPTION = (
    "Rendered capsule hands with Kinect-like noise; crops 128 x 128 in [-1, 1], joints in half-cubes from the crop "
    "centre (camera axes, x right, y up, z away), dof: the hand model's inputs; lengths in mm."
)


@dataclass(frozen=True)
class Part:
    """One file to be: which frames of which split."""

    path: Path
    generator: Generator
    start: int
    frames: int

    @property
    def recipe(self) -> str:
        """All that the file depends on."""
        return json.dumps({**self.generator.recipe(), "start": self.start, "frames": self.frames}, sort_keys=True)


class StoppedError(Exception):
    """A signal asked the run to end."""


class Stopper:
    """Within it, the first Ctrl-C or SIGTERM is only noted, to be raised by ``check``; a second one hits at once.

    An exception that the signal itself raised could fall into a place that swallows it.
    """

    signum = 0
    _before: dict[signal.Signals, Any]

    def __enter__(self) -> Stopper:
        self._before = {}
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, signum: int, frame: FrameType | None) -> None:
        self.signum = signum
        self.__exit__()

    def check(self) -> None:
        """Raise StoppedError if a signal came."""
        if self.signum:
            raise StoppedError


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns its exit status."""
    args = _arguments(argv)
    counts: dict[Split, int] = {"train": args.train, "test": args.test}
    return guarded(lambda: run(args.out, counts, args.seed, args.workers, args.force))


def run(out: Path, counts: dict[Split, int], seed: int, workers: int, force: bool) -> int:
    """Write what is missing of ``counts`` frames a split into the folder ``out``. Raises NetlibError."""
    parts = {split: _parts(out, Generator(seed, split), count) for split, count in counts.items()}
    every = [part for split in parts.values() for part in split]
    lists = {out / f"{split}.txt": "".join(f"{p.path.as_posix()}\n" for p in parts[split]) for split in parts}
    if not force:
        _refuse_foreign([part.path for part in every], list(lists))
    missing = every if force else [part for part in every if not _is_whole(part)]
    if not missing and all(_text(path) == text for path, text in lists.items()):
        print(f"{out}: {_summary(counts, seed)} are already there, kept")
        return 0

    begun = time.perf_counter()
    try:
        with Stopper() as stopper:
            out.mkdir(parents=True, exist_ok=True)
            for path in lists if missing else ():
                path.unlink(missing_ok=True)  # no list may name files of two kinds
            _check_space(out, missing)
            _write_all(missing, workers, stopper)
            for path, text in lists.items():
                _replace(path, lambda temporary, text=text: temporary.write_text(text))  # type: ignore[misc]
    except StoppedError:
        print("stopped; whole files are kept, and the next run goes on after them", file=sys.stderr)
        return 128 + stopper.signum
    except OSError as error:
        raise NetlibError(f"{out}: {_reason(error)}") from None
    made = sum(part.frames for part in missing)
    print(f"{out}: {_summary(counts, seed)}; made {made} of them in {duration(time.perf_counter() - begun)}")
    return 0


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("data/nyu"), help="folder to write to (default: %(default)s)")
    parser.add_argument("--train", type=_at_least(1), default=20000, metavar="N", help="frames (default: %(default)s)")
    parser.add_argument("--test", type=_at_least(1), default=2000, metavar="N", help="frames (default: %(default)s)")
    parser.add_argument("--seed", type=_at_least(0), default=0, metavar="N", help="random seed (default: %(default)s)")
    workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    help_ = "processes (default: one a core, %(default)s)"
    parser.add_argument("--workers", type=_at_least(1), default=workers, metavar="N", help=help_)
    parser.add_argument("--force", action="store_true", help="replace whatever is there, real data too")
    return parser.parse_args(argv)


def _at_least(least: int) -> Callable[[str], int]:
    def number(text: str) -> int:
        if not text.isascii() or not text.isdigit() or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r}, expected a whole number of {least} or more")
        return int(text)

    return number


def _summary(counts: dict[Split, int], seed: int) -> str:
    return " and ".join(f"{count} {split}" for split, count in counts.items()) + f" frames (synthetic, seed {seed})"


def _parts(out: Path, generator: Generator, count: int) -> list[Part]:
    starts = range(0, count, FRAMES_PER_FILE)
    return [
        Part(out / f"{generator.split}_{i:03d}.h5", generator, start, min(FRAMES_PER_FILE, count - start))
        for i, start in enumerate(starts)
    ]


# --------------------------------------------------------------------------------------- what is there


def _attributes(path: Path) -> dict[str, object] | None:
    """The attributes of an HDF5 file, or None if it is none."""
    try:
        with h5py.File(path, "r") as file:
            return dict(file.attrs)
    except OSError:
        return None


def _is_whole(part: Part) -> bool:
    attributes = _attributes(part.path) if part.path.is_file() else None
    return attributes is not None and attributes.get("recipe") == part.recipe


def _refuse_foreign(files: list[Path], lists: list[Path]) -> None:
    """Raise NetlibError if a file to be replaced, or one that a list to be replaced names, is not synthetic."""
    listed = [Path(line.strip()) for path in lists for line in (_text(path) or "").splitlines() if line.strip()]
    for path in dict.fromkeys(files + listed):
        if not path.exists():
            continue
        attributes = _attributes(path)
        if attributes is None:
            raise NetlibError(f"{path}: not a readable HDF5 file; move it away, choose another --out, or use --force")
        origin = attributes.get("made_from", "an unknown source")
        if origin != MADE_FROM:
            raise NetlibError(
                f"{path}: holds data made from {origin}; choose another --out, or use --force to replace it"
            )


def _text(path: Path) -> str | None:
    """The text of a file, or None if there is none."""
    try:
        return path.read_text()
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise NetlibError(f"{path}: {os_reason(error) if isinstance(error, OSError) else 'not a text file'}") from None


def _check_space(out: Path, missing: list[Part]) -> None:
    """Raise NetlibError at once rather than after a minute if the disk is too small."""
    replaced = sum(part.path.stat().st_size for part in missing if part.path.is_file())
    need = sum(part.frames for part in missing) * BYTES_PER_FRAME
    free = shutil.disk_usage(out).free + replaced
    if need > free:
        raise NetlibError(f"{out}: needs {need / 1e6:.0f} MB, {free / 1e6:.0f} MB are free")


# --------------------------------------------------------------------------------------------- writing


def _write_all(parts: list[Part], workers: int, stopper: Stopper) -> None:
    bar = progress_bar(sum(part.frames for part in parts), 0, " frames") if parts else None

    def advance(frames: int) -> None:
        if bar:
            bar.update(frames)
        stopper.check()

    with contextlib.ExitStack() as stack:
        if bar:
            stack.callback(bar.close)
        pool = stack.enter_context(processes(workers)) if workers > 1 and parts else 1
        for part in parts:
            _replace(part.path, lambda path, part=part: _write(path, part, pool, advance))  # type: ignore[misc]


def _write(path: Path, part: Part, workers: int | ProcessPoolExecutor, advance: Callable[[int], None]) -> None:
    """HDF5 lays out the file, plain writes fill it: where HDF5 fails to write, it takes the process with it."""
    with path.open("wb") as file:
        _reserve(file.fileno(), part.frames * BYTES_PER_FRAME)
    offsets = _lay_out(path, part)
    with path.open("r+b") as file:
        _reserve(file.fileno(), path.stat().st_size)
        done = 0
        for frames in generate(part.frames, part.generator, workers, part.start):
            for name, array in frames.arrays().items():
                file.seek(offsets[name] + done * array[0].nbytes)
                file.write(np.ascontiguousarray(array).data)
            done += len(frames)
            advance(len(frames))


def _lay_out(path: Path, part: Part) -> dict[str, int]:
    """Make the file with its data sets still empty; returns where each begins."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    plist.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    # Whole pages, so that readers can map the frames into memory.
    with h5py.File(path, "w", alignment_threshold=1 << 16, alignment_interval=4096) as file:
        file.attrs["made_from"] = MADE_FROM
        file.attrs["seed"] = part.generator.seed
        file.attrs["description"] = DESCRIPTION
        file.attrs["recipe"] = part.recipe
        for name, array in empty_frames().arrays().items():
            file.create_dataset(name, (part.frames, *array.shape[1:]), array.dtype, dcpl=plist)
        return {name: file[name].id.get_offset() for name in file}


def _reserve(handle: int, size: int) -> None:
    """Take the room on the disk before work goes into filling it."""
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(handle, 0, size)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # some file systems cannot
                raise


def _replace(path: Path, fill: Callable[[Path], object]) -> None:
    """Have ``fill`` write a temporary file, which then takes the place of ``path``, whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        fill(temporary)
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
        if os.name == "posix":  # the new name, too, must reach the disk
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    finally:
        temporary.unlink(missing_ok=True)


def _reason(error: OSError) -> str:
    """The plain reason, which HDF5 wraps in a long message."""
    wrapped = re.search(r"error message = '([^']*)'", str(error))
    return wrapped.group(1) if wrapped else os_reason(error)


if __name__ == "__main__":
    sys.exit(main())
