#!/usr/bin/env python3
"""Demonstrate prediction: detect, predict and fit hands in rendered depth frames with the
packaged weights.

    python tools/demo.py --out demo

writes six depth frames as a Kinect would record them (frame_*.png, 16-bit grey, mm), of six people,
with right and left hands in turn. It runs the same prediction on them as tools/predict.py, and
draws demo/hands.png: the crop of each frame with the skeleton, the fitted surface, and the hand in
space; above them the confidence of the fit, its expected error and its true error. Of a hand that
is less than 30% sure there are no joints, and only the crop is drawn. demo/hands.json has the
numbers in the format of a track, and for each hand its true error in mm (``true_error_mm``).
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np
from numpy.typing import NDArray

from handpose import NYU, load_predictor
from handpose.estimate.hand import HandEstimate
from handpose.estimate.predictor import Predictor
from handpose.output.drawing import sheets
from handpose.output.drawing.view import percent
from handpose.scoring.metrics import mean_errors_14
from netlib.blob import Array
from netlib.files import atomic
from tools.common import outputs, prediction_outputs
from tools.common.arguments import count, parser_of, seed
from tools.common.commands import command
from tools.common.console import guarded, say
from tools.common.progress import ProgressBar

VIEWS = 3  # of a hand: the skeleton on the crop, the fitted surface, the hand in space


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("demo"), help="default: %(default)s"
    )
    parser.add_argument("--frames", type=count, default=6, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="random seed (default: %(default)s)"
    )
    return guarded(run, parser.parse_args(argv))


class Predicted(NamedTuple):
    """The hand predicted in a frame with this file name, and its true error in mm, NaN without
    joints.
    """

    name: str
    hand: HandEstimate
    error_mm: float


def run(args: argparse.Namespace) -> None:
    """Render, predict and draw. Raises NetlibError."""
    outputs.make_folder(args.out)
    predictor = load_predictor(NYU)
    every: list[Predicted] = []
    begun = time.perf_counter()
    with ProgressBar(args.frames) as progress:
        for n in range(args.frames):
            frame, truth = scene(args.seed + n)
            name = f"frame_{n}.png"
            outputs.write_image(args.out / name, frame)
            found = predictor.in_frame(frame)
            error_mm = mean_errors_14(found.xyz[None], truth[None])[0]
            every.append(Predicted(name, found, float(error_mm)))
            progress(1)
    outputs.write_image(args.out / "hands.png", _sheet(every, predictor))
    atomic.replace_text(args.out / "hands.json", _document(every, predictor) + "\n")
    say(f"{args.frames} frames in {time.perf_counter() - begun:.1f} s: {args.out / 'hands.png'}")
    options = [str(args.out / "frame_0.png"), "--camera", "nyu", "--out", str(args.out)]
    say(f"For your own camera: {command('predict')} {shlex.join(options)}")


def _sheet(every: Sequence[Predicted], predictor: Predictor) -> NDArray[np.uint8]:
    """A picture of all hands, each with its side, its errors and its confidence."""
    images, titles = [], []
    for _, hand, error_mm in every:
        drawn = prediction_outputs.views(hand, predictor, zoom=2)
        white = np.full_like(drawn[0], 255)
        images += [*drawn, *[white] * (VIEWS - len(drawn))]
        result = f"below {predictor.min_confidence:.0%}: no joints"
        if hand.has_joints:
            result = f"true error {error_mm:.0f} mm"
        sure = f"{hand.hand}, {percent(hand.confidence)} sure"
        titles += [sure, f"expected {hand.error_mm:.0f} mm", result]
    columns = VIEWS if len(every) <= 2 else 2 * VIEWS
    return sheets.sheet(images, columns, titles)


def _document(every: Sequence[Predicted], predictor: Predictor) -> str:
    """The hands as JSON, as ``predict.py`` writes them, with their true errors."""
    frames = []
    for n, (name, hand, error_mm) in enumerate(every):
        values = prediction_outputs.frame_values(n, hand, predictor.skeleton)
        if hand.has_joints:
            values["hands"][0]["true_error_mm"] = round(error_mm, 1)
        frames.append({"image": name, **values})
    hands = [one.hand for one in every]
    return prediction_outputs.document("demo", hands, frames, predictor.skeleton)


def scene(number: int) -> tuple[NDArray[np.uint16], Array]:
    """A depth frame (mm) of a person, another one for each number, and the true joints
    (31, 3) of the hand.

    Even numbers have a right hand that shows a gesture, odd ones a left hand on its way.
    """
    # here, because SciPy's rotations take a while
    from handpose.sequences.recordings import SyntheticRecording

    left = number % 2 == 1
    recording = SyntheticRecording("body", NYU, rate=1, seed=number, mirrored=left)
    truth = next(
        truth for truth in recording.truths() if truth.number >= (4 if left else 11) and truth.hands
    )
    return recording.frame(truth.number).depth.astype(np.uint16), truth.hands[0].xyz


if __name__ == "__main__":
    sys.exit(main())
