#!/usr/bin/env python3
"""Make synthetic training and test data: depth crops of random hands with their joints.

    python tools/make_synthetic.py --out data/nyu --train 20000 --test 2000

writes train_000.h5, train_001.h5, ... of 2,500 frames each, test_000.h5, and the lists train.txt and test.txt
that HDF5Data layers read. What is already there and the same is kept, so a second run returns at once and a
run that was interrupted goes on where it stopped. Data not made by this tool is left alone without --force.

    python tools/make_synthetic.py --raw --out data/nyu_raw --train 200 --test 100

writes the same frames as the NYU data set has them: whole depth images in train/ and test/, and joint_data.mat
with the labels, for tools/prepare_nyu.py. Depth is whole millimetres there.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run as a file: find the packages

from handpose.data import nyu_files, parts
from handpose.data.crops import restore_joints, window
from handpose.data.images import pack_depth
from handpose.facts.nyu import frame_name
from handpose.synthetic.generator import BLOCK, Generator, Scene, Split
from handpose.synthetic.many import generate
from handpose.synthetic.workers import no_interrupt, processes
from netlib import atomic, engine
from netlib.errors import NetlibError, reason_of
from netlib.paths import names_in
from tools.console import duration, guarded, progress_bar
from tools.stopper import StoppedError, Stopper

FRAMES_PER_FILE = 2500
RAW_BYTES = 60_000  # of a frame of NYU's format, more than it takes
MADE_FROM = nyu_files.SYNTHETIC
MARKER = "synthetic.json"  # in a folder of NYU's format: ours, and made so
DESCRIPTION = (
    "Rendered capsule hands with Kinect-like noise; crops 128 x 128 in [-1, 1], joints in half-cubes from the crop "
    "centre (camera axes, x right, y up, z away), dof: the hand model's inputs; lengths in mm."
)


class Piece(NamedTuple):
    """Which frames of which split a file is made of."""

    part: parts.Part
    generator: Generator
    start: int


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns its exit status."""
    args = _arguments(argv)
    counts: dict[Split, int] = {"train": args.train, "test": args.test}
    if args.raw:
        out = args.out or Path("data/nyu_raw")
        return guarded(lambda: run_raw(out, counts, args.seed, args.workers, args.force))
    return guarded(lambda: run(args.out or Path("data/nyu"), counts, args.seed, args.workers, args.force))


def run(out: Path, counts: dict[Split, int], seed: int, workers: int, force: bool) -> int:
    """Write what is missing of ``counts`` frames a split into the folder ``out``. Raises NetlibError."""
    pieces = {split: _pieces(out, Generator(seed, split), count) for split, count in counts.items()}
    every = [piece for split in pieces.values() for piece in split]
    lists = {out / f"{split}.txt": parts.list_text(p.part.path for p in pieces[split]) for split in pieces}
    if not force:
        parts.refuse_foreign([piece.part.path for piece in every], list(lists), [MADE_FROM])
    missing = every if force else [piece for piece in every if not parts.is_whole(piece.part)]
    if not missing and all(atomic.text_of(path) == text for path, text in lists.items()):
        print(f"{out}: {_summary(counts, seed)} are already there, kept")
        return 0

    def work(stopper: Stopper) -> None:
        out.mkdir(parents=True, exist_ok=True)
        for path in lists if missing else ():
            path.unlink(missing_ok=True)  # no list may name files of two kinds
        parts.check_space(out, [piece.part for piece in missing], every[0].generator.columns())
        _write_all(missing, workers, stopper)
        for path, text in lists.items():
            atomic.replace_text(path, text)

    made = sum(piece.part.rows for piece in missing)
    return _stoppable(out, work, "whole files are", f"{_summary(counts, seed)}; made {made} of them")


def _stoppable(out: Path, work: Callable[[Stopper], None], kept: str, done: str) -> int:
    """Do the work; a signal ends it with status 130 or 143. Raises NetlibError."""
    begun = time.perf_counter()
    try:
        with Stopper() as stopper:
            work(stopper)
    except StoppedError:
        print(f"stopped; {kept} kept, and the next run goes on after them", file=sys.stderr)
        return 128 + stopper.signum
    except OSError as error:
        raise NetlibError(f"{out}: {reason_of(error)}") from None
    print(f"{out}: {done} in {duration(time.perf_counter() - begun)}")
    return 0


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--raw", action="store_true", help="write images and labels in the format of the NYU data set")
    parser.add_argument("--out", type=Path, help="folder to write to (default: data/nyu, with --raw data/nyu_raw)")
    parser.add_argument("--train", type=_at_least(1), default=20000, metavar="N", help="frames (default: %(default)s)")
    parser.add_argument("--test", type=_at_least(1), default=2000, metavar="N", help="frames (default: %(default)s)")
    parser.add_argument("--seed", type=_at_least(0), default=0, metavar="N", help="random seed (default: %(default)s)")
    workers = engine.available_cpus()
    help_ = "processes (default: one per processor, %(default)s)"
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


def _pieces(out: Path, generator: Generator, count: int) -> list[Piece]:
    pieces = []
    for i, start in enumerate(range(0, count, FRAMES_PER_FILE)):
        rows = min(FRAMES_PER_FILE, count - start)
        # all that the file depends on
        recipe = json.dumps({**generator.recipe(), "start": start, "frames": rows}, sort_keys=True)
        path = out / f"{generator.split}_{i:03d}.h5"
        pieces.append(Piece(parts.Part(path, rows, recipe), generator, start))
    return pieces


# --------------------------------------------------------------------------------------------- writing


def _write_all(pieces: list[Piece], workers: int, stopper: Stopper) -> None:
    bar = progress_bar(sum(piece.part.rows for piece in pieces), 0, " frames") if pieces else None
    with contextlib.ExitStack() as stack:
        if bar:
            stack.callback(bar.close)
        pool = stack.enter_context(processes(workers)) if workers > 1 and pieces else 1

        def rows(piece: Piece) -> Iterator[dict[str, NDArray[Any]]]:
            for frames in generate(piece.part.rows, piece.generator, pool, piece.start):
                yield frames.arrays()
                if bar:
                    bar.update(len(frames))
                stopper.check()

        for piece in pieces:
            facts = {"made_from": MADE_FROM, "seed": piece.generator.seed, "description": DESCRIPTION}
            parts.write_part(piece.part, piece.generator.columns(), rows(piece), lambda facts=facts: facts)  # type: ignore[misc]


# ------------------------------------------------------------------------------------------ NYU's format


def run_raw(out: Path, counts: dict[Split, int], seed: int, workers: int, force: bool) -> int:
    """Write ``counts`` frames a split in NYU's format into the folder ``out``. Raises NetlibError."""
    generators = [Generator(seed, split) for split in counts]
    recipes = {g.split: json.dumps({**g.recipe(), "frames": counts[g.split]}, sort_keys=True) for g in generators}
    missing = []
    for generator in generators:
        folder = out / generator.split
        marker = atomic.text_of(folder / MARKER)
        if not force and marker is None and names_in(folder):
            raise NetlibError(f"{folder}: holds what this tool did not make; choose another --out, or use --force")
        if force or marker != recipes[generator.split] or not (folder / nyu_files.ANNOTATION).is_file():
            missing.append(generator)
    if not missing:
        print(f"{out}: {_summary(counts, seed)} are already there in NYU's format, kept")
        return 0

    def work(stopper: Stopper) -> None:
        out.mkdir(parents=True, exist_ok=True)
        need = sum(counts[g.split] for g in missing) * RAW_BYTES
        parts.check_room(out, need)
        bar = progress_bar(sum(counts[g.split] for g in missing), 0, " frames")
        with contextlib.ExitStack() as stack:
            if bar:
                stack.callback(bar.close)
            for generator in missing:
                for frames in _write_raw(out / generator.split, generator, counts[generator.split],
                                         recipes[generator.split], workers):  # fmt: skip
                    if bar:
                        bar.update(frames)
                    stopper.check()

    return _stoppable(out, work, "whole splits are", f"{_summary(counts, seed)} in NYU's format, made")


def _write_raw(folder: Path, generator: Generator, count: int, recipe: str, workers: int) -> Iterator[int]:
    """Write one split; the labels come last, and make it whole. Yields numbers of frames."""
    folder.mkdir(exist_ok=True)
    (folder / nyu_files.ANNOTATION).unlink(missing_ok=True)
    for name in names_in(folder) if (folder / MARKER).exists() else ():  # from an earlier run
        if name.startswith("depth_1_") and name.endswith(".png"):
            (folder / name).unlink()
    atomic.replace_text(folder / MARKER, recipe)
    numbers = range(-(-count // BLOCK))
    labels = []
    with contextlib.ExitStack() as stack:
        if workers > 1:
            pool = stack.enter_context(processes(workers))
            with no_interrupt():
                jobs = [pool.submit(_raw_block, generator, number, folder, count) for number in numbers]
            results = (job.result() for job in jobs)
        else:
            results = (_raw_block(generator, number, folder, count) for number in numbers)
        for block in results:
            labels.append(block)
            yield len(block)
    nyu_files.write_annotation(folder / nyu_files.ANNOTATION, np.concatenate(labels), MADE_FROM)


def _raw_block(generator: Generator, number: int, folder: Path, count: int) -> NDArray[np.float64]:
    """Write the images of a block; returns the 36 annotated joints (n, 36, 3) in mm."""
    scene = generator.scene(number)
    for n in range(min(BLOCK, count - number * BLOCK)):
        # level 1 is twice as fast as OpenCV's default, and these images are mostly empty
        png = cv2.imencode(".png", pack_depth(_image(scene, n, generator)), (cv2.IMWRITE_PNG_COMPRESSION, 1))[1]
        path = folder / frame_name(number * BLOCK + n)
        atomic.replace(path, lambda temporary, png=png: temporary.write_bytes(png.tobytes()), sync=False)  # type: ignore[misc]
    center = generator.camera.unproject(scene.center_uvd)
    xyz = restore_joints(scene.hands.joints, center, generator.cube_mm / 2)
    return nyu_files.annotation_of(xyz, center)[: count - number * BLOCK]


def _image(scene: Scene, n: int, generator: Generator) -> NDArray[np.float64]:
    """The whole depth image in mm of one frame: its crop, enlarged to the pixels it was picked from; 0 around it."""
    camera, half = generator.camera, generator.cube_mm / 2
    center = scene.center_uvd[n : n + 1]
    crop = scene.depth[n].astype(np.float64)
    mm = np.where(crop <= -1, np.floor(center[0, 2] - half), np.rint(center[0, 2] + crop * half))
    mm[crop >= 1] = 0
    picked = window(center, generator.cube_mm, camera)
    image = np.zeros((camera.height, camera.width))
    # Each pixel of the image takes the value of the last one picked before it, or of itself.
    across, i = _enlarge(picked.columns[0], camera.width)
    down, j = _enlarge(picked.rows[0], camera.height)
    image[down, across] = mm[np.ix_(j, i)]
    return image


def _enlarge(picked: NDArray[np.int64], pixels: int) -> tuple[slice, NDArray[np.int64]]:
    """Which image pixels along an axis a crop's cover, and which of the crop's pixels each of them shows."""
    shown = np.flatnonzero(picked >= 0)
    at = picked[shown]
    step = int(np.ceil((at[-1] - at[0]) / max(len(at) - 1, 1)))
    all_ = np.arange(at[0], min(at[-1] + max(step, 1), pixels))
    return slice(all_[0], all_[-1] + 1), shown[np.searchsorted(at, all_, side="right") - 1]


if __name__ == "__main__":
    sys.exit(main())
