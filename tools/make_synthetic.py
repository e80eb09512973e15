"""Make synthetic training and test data: depth crops of random hands with their joints.

    python tools/make_synthetic.py --out data/nyu --train 20000 --test 2000

writes train_000.h5, train_001.h5, ... of 2,500 frames each, test_000.h5, and the lists train.txt and test.txt
that HDF5Data layers read. What is already there and the same is kept, so a second run returns at once and a
run that was interrupted goes on where it stopped. Data not made by this tool is left alone without --force.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import h5py

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run as a file: find the packages

from handpose.synthetic import Frames, Generator, Split, generate, processes
from netlib.errors import NetlibError, os_reason

FRAMES_PER_FILE = 2500
MADE_FROM = "synthetic"
DESCRIPTION = (
    "Rendered capsule hands with Kinect-like noise; crops 128 x 128 in [-1, 1], joints in half-cubes from the crop "
    "centre (camera axes, x right, y up, z away), dof: the hand model's inputs; lengths in mm."
)


class Part(NamedTuple):
    """One file to be: which frames of which split."""

    path: Path
    generator: Generator
    start: int
    count: int

    @property
    def recipe(self) -> str:
        """All that the file depends on."""
        return json.dumps({**self.generator.recipe(), "start": self.start, "count": self.count}, sort_keys=True)


class Stopped(Exception):
    """A signal asked the run to end."""


class Stopper:
    """Within it, the first Ctrl-C or SIGTERM is only noted, to be raised by ``check``; a second one hits at once.

    An exception raised by the signal itself could fall into a place that swallows it, or half way into a file.
    """

    signum = 0
    _before: dict[int, Any]

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
        """Raise Stopped if a signal came."""
        if self.signum:
            raise Stopped


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns its exit status."""
    args = _arguments(argv)
    stopper = Stopper()
    try:
        with stopper:
            return run(args.out, {"train": args.train, "test": args.test}, args.seed, args.workers, args.force, stopper)
    except NetlibError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except (Stopped, KeyboardInterrupt):
        print("stopped; whole files are kept, and the next run goes on after them", file=sys.stderr)
        return 128 + (stopper.signum or signal.SIGINT)


def run(out: Path, counts: dict[Split, int], seed: int, workers: int, force: bool, stopper: Stopper) -> int:
    """Write what is missing of ``counts`` frames a split into the folder ``out``."""
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
        out.mkdir(parents=True, exist_ok=True)
        for path in lists if missing else ():
            path.unlink(missing_ok=True)  # no list may name files of two kinds
        _check_space(out, missing)
        with _progress(sum(part.count for part in missing)) as advance, processes(workers) as pool:
            for part in missing:
                _write(part, pool if workers > 1 else 1, advance, stopper)
        for path, text in lists.items():
            _replace(path, lambda temporary, text=text: temporary.write_text(text))
    except OSError as error:
        raise NetlibError(f"{out}: {_reason(error)}") from None
    made = sum(part.count for part in missing)
    print(f"{out}: {_summary(counts, seed)}; made {made} of them in {time.perf_counter() - begun:.0f} s")
    return 0


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("data/nyu"), help="folder to write to (default: %(default)s)")
    parser.add_argument("--train", type=_at_least(1), default=20000, metavar="N", help="frames (default: %(default)s)")
    parser.add_argument("--test", type=_at_least(1), default=2000, metavar="N", help="frames (default: %(default)s)")
    parser.add_argument("--seed", type=_at_least(0), default=0, metavar="N", help="random seed (default: %(default)s)")
    workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    parser.add_argument(
        "--workers",
        type=_at_least(1),
        default=workers,
        metavar="N",
        help="processes (default: %(default)s, one a core)",
    )
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
    need = sum(part.count for part in missing) * 67_000  # bytes a frame
    free = shutil.disk_usage(out).free + replaced
    if need > free:
        raise NetlibError(f"{out}: needs {need / 1e6:.0f} MB, {free / 1e6:.0f} MB are free")


# --------------------------------------------------------------------------------------------- writing


def _write(part: Part, workers: int | ProcessPoolExecutor, advance: Callable[[int], object], stopper: Stopper) -> None:
    def fill(path: Path) -> None:
        # Whole pages, so that readers can map the frames into memory.
        with h5py.File(path, "w", alignment_threshold=1 << 16, alignment_interval=4096) as file:
            file.attrs["made_from"] = MADE_FROM
            file.attrs["seed"] = part.generator.seed
            file.attrs["description"] = DESCRIPTION
            file.attrs["recipe"] = part.recipe
            done = 0
            with contextlib.closing(generate(part.count, part.generator, workers, part.start)) as blocks:
                for frames in blocks:
                    n = len(frames.index)
                    for name, array in zip(Frames._fields, frames, strict=True):
                        if not done:
                            file.create_dataset(name, (part.count, *array.shape[1:]), array.dtype)
                        file[name][done : done + n] = array
                    done += n
                    advance(n)
                    stopper.check()

    try:
        _replace(part.path, fill)
    except RuntimeError as error:  # h5py's for a file that it cannot close, as after a failed write
        if isinstance(error.__context__, OSError):
            raise error.__context__ from None
        raise


def _replace(path: Path, fill: Callable[[Path], object]) -> None:
    """Have ``fill`` write a temporary file, which then takes the place of ``path``, whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        fill(temporary)
        for written in (temporary, path.parent):
            if written is temporary or os.name == "posix":
                handle = os.open(written, os.O_RDONLY)
                try:
                    os.fsync(handle)
                finally:
                    os.close(handle)
            if written is temporary:
                os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _reason(error: OSError) -> str:
    """The plain reason, which HDF5 wraps in a long message."""
    wrapped = re.search(r"error message = '([^']*)'", str(error))
    return wrapped.group(1) if wrapped else os_reason(error)


@contextlib.contextmanager
def _progress(total: int) -> Iterator[Callable[[int], object]]:
    """A progress bar if there is a terminal to show it and tqdm to draw it; yields the function to advance it."""
    if not sys.stderr.isatty():
        yield lambda frames: None
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield lambda frames: None
        return
    with tqdm(total=total, unit=" frames", unit_scale=True, file=sys.stderr) as bar:
        yield bar.update


if __name__ == "__main__":
    sys.exit(main())
