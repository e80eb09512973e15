"""Recall of the finder of hands, at numbers of false hands a frame.

    python -m experiments finder snapshots/finder_iter_18000.caffemodel.h5
    python -m experiments finder WEIGHTS --recording take take_left.npy take_right.npy

Synthetic scenes are those of the training's generator with other random numbers ("test"), and
frames of synthetic recordings with other cameras, of another person each, half of them mirrored
("other"). Labels of a recording are joints (frames, ..., 3) in mm, x right, y down, z away, NaN
where there is none; the middle of a hand's joints is its place. A hand is found within 80 mm of it;
each further answer is false. "mm" is the median distance of the hands found at one false hand a
frame.

--reliability shows whether presence is a probability: of the answers of each presence, the share
that are hands.

--things counts, in scenes without hands, what is taken for one: the shares of things in the scene
prior follow from that.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.labelled_frames import (
    Labelled,
    camera_of,
    drawn_scenes,
    first_scenes,
    other_scenes,
    recorded,
)
from experiments.tables import tabulated
from handpose.estimate.finder import Finder, FoundHand
from handpose.estimate.packaged import HAND_FINDER
from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.whole_scenes import SceneGenerator
from netlib.proto import schema
from netlib.training.trained import trained
from tools.common.arguments import add_engine, count, seed
from tools.common.console import aligned

WITHIN_MM = 80.0  # maximum distance of a found hand from a labelled one
RATES = (0.5, 1.0, 2.0)  # false hands a frame
DISTANCE_RATE = 1.0  # at which the median distance is measured
MIN_PRESENCE, MAX_ANSWERS = 0.01, 12  # of the answers of a frame that are counted
EDGES = (0.01, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # between rows of presences


class Answer(NamedTuple):
    """One found hand of a frame: of a labelled hand, or false."""

    presence: float
    true: bool
    off_mm: float = 0.0


class Measured(NamedTuple):
    """The answers in some frames.

    hands    number of labelled ones
    frames   number
    seconds  of processor time
    """

    answers: list[Answer]
    hands: int
    frames: int
    seconds: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("weights", metavar="WEIGHTS", help="weights of the finder, *.caffemodel.h5")
    parser.add_argument(
        "--model",
        metavar="NET",
        default=str(HAND_FINDER / "deploy.prototxt"),
        help="default: models/hand_finder",
    )
    parser.add_argument(
        "--scenes", type=count, default=160, metavar="N", help="of each kind (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=seed, default=1000, metavar="N", help="of the scenes (default: %(default)s)"
    )
    parser.add_argument(
        "--recording",
        nargs="+",
        action="append",
        default=[],
        metavar=("SOURCE", "LABELS.npy"),
        help="frames, and files of the joints of their hands; may be given several times",
    )
    parser.add_argument(
        "--reliability",
        action="store_true",
        help="instead, how many answers of each presence are hands",
    )
    parser.add_argument(
        "--things",
        action="store_true",
        help="instead, what is taken for a hand in scenes without hands",
    )
    add_engine(parser)


def run(args: argparse.Namespace) -> None:
    """Measure the finder. Raises NetlibError."""
    finder = Finder(trained(args.model, args.weights, args.engine))
    if args.things:
        print(aligned(things_taken_for_hands(finder, args.seed, args.scenes)))
        return
    sources = {
        "test": drawn_scenes(args.seed, args.scenes),
        "other": other_scenes(args.seed, args.scenes),
    }
    for source, *labels in args.recording:
        sources[Path(source).name] = recorded(source, labels)
    found = {name: measured(finder, frames) for name, frames in sources.items()}
    if args.reliability:
        rows = reliability({name: one.answers for name, one in found.items()})
    else:
        rows = [{"frames of": name, **cells_of(one)} for name, one in found.items()]
    print(tabulated(rows))


def measured(finder: Finder, frames: Iterator[Labelled]) -> Measured:
    """What the finder answers in the frames. Raises NetlibError."""
    answers: list[Answer] = []
    hands, count, seconds = 0, 0, 0.0
    for frame in frames:
        begun = time.process_time()
        found = finder.hands(frame.depth, frame.camera, MIN_PRESENCE, MAX_ANSWERS)
        seconds += time.process_time() - begun
        answers += judged(found, frame)
        hands += len(frame.hands)
        count += 1
    return Measured(answers, hands, count, seconds)


def cells_of(found: Measured) -> dict[str, str]:
    """The columns of some frames."""
    answers, hands, count, seconds = found
    cells = {"count": str(count), "hands": str(hands)}
    if not count:
        return cells
    recalls, threshold = recalls_of(answers, hands, count)
    off_mm = [answer.off_mm for answer in answers if answer.true and answer.presence >= threshold]
    for rate, recall in zip(RATES, recalls):
        cells[f"recall at {rate:g}"] = f"{recall:.0%}"
    cells["mm"] = f"{np.median(off_mm):.0f}" if off_mm else ""
    cells["CPU ms"] = f"{1000 * seconds / count:.0f}"
    return cells


def reliability(answers: dict[str, list[Answer]]) -> list[dict[str, str]]:
    """A row for each range of presences: the number of answers and the share that are hands, for
    each kind of frames.
    """
    rows = []
    for low, high in itertools.pairwise(EDGES):
        row = {"presence": f"{low:.0%} to {high:.0%}"}
        for name, found in answers.items():
            true = [answer.true for answer in found if low <= answer.presence < high]
            row[name] = f"{np.mean(true):.0%} of {len(true)}" if true else ""
        rows.append(row)
    return rows


def judged(found: Sequence[FoundHand], frame: Labelled) -> list[Answer]:
    """The answers of a frame; of several near one labelled hand, the most certain one is true.

    Those near a doubtful hand do not count.
    """
    left, answers = list(frame.hands), []
    for hand in found:
        off_mm = [float(np.linalg.norm(hand.middle - place)) for place in left]
        if off_mm and min(off_mm) < WITHIN_MM:
            del left[int(np.argmin(off_mm))]
            answers.append(Answer(hand.presence, True, min(off_mm)))
        elif not any(np.linalg.norm(hand.middle - place) < WITHIN_MM for place in frame.doubtful):
            answers.append(Answer(hand.presence, False))
    return answers


def recalls_of(answers: Sequence[Answer], hands: int, frames: int) -> tuple[list[float], float]:
    """Recall at each of ``RATES``, and the minimum presence of the answers that count at
    ``DISTANCE_RATE``, above 1 if none does.
    """
    order = sorted(answers, key=lambda answer: -answer.presence)
    false = np.cumsum([not answer.true for answer in order])
    true = np.cumsum([answer.true for answer in order])
    # how many answers count: as long as there are no more false ones
    counts = {rate: int(np.searchsorted(false, rate * frames, side="right")) for rate in RATES}
    recalls = [
        float(true[count - 1]) / max(hands, 1) if count else 0.0 for count in counts.values()
    ]
    count = counts[DISTANCE_RATE]
    return recalls, order[count - 1].presence if count else 2.0


def things_taken_for_hands(finder: Finder, number: int, scenes: int) -> list[list[str]]:
    """A row for each thing of scenes without hands: pixels that show it, and false hands there."""
    prior = scene_prior.load()
    prior = schema.changed(prior, hands=schema.changed(prior.hands, none=1.0))
    generator = SceneGenerator(number, "test", prior)
    pixels, false = Counter[str](), Counter[str]()
    names = np.array(generator.names)
    for block, n in first_scenes(generator, scenes):
        camera = camera_of(block, n)
        shown = np.where(block.depth[n] > 0, names[block.what[n]], "nothing")
        pixels.update(shown.ravel().tolist())
        for hand in finder.hands(block.depth[n], camera, most=MAX_ANSWERS):
            u, v, _ = np.rint(camera.project(hand.middle)).astype(int)
            false[str(shown[v, u])] += 1
    rows = [["taken for a hand", "pixels", "times", "a frame"]]
    for name, times in false.most_common():
        share = pixels[name] / pixels.total()
        rows.append([name, f"{share:.1%}", str(times), f"{times / scenes:.3f}"])
    return rows
