"""Chapter 0's second training: the paper's network on frames that are rendered first, in
about five minutes.

python -m docs.making.five_minutes            4,096 frames; the picture is five_minutes.svg
python -m docs.making.five_minutes --frames 64 --out by_heart.svg
                                              so few that the network learns them by heart
python -m docs.making.five_minutes --book     both; draws learned.svg and by_heart.svg of the book

The errors are those of 256 held-out frames and of up to 256 training frames.
"""

from __future__ import annotations

import argparse
import itertools
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import netlib
from docs.making.figures.drawing import PLACE, write
from docs.making.figures.whole import (
    Frames,
    Progress,
    error_mm,
    errors_over_time,
    hands_over_time,
    joints_of,
    rendered,
)
from netlib.blob import Array
from netlib.files.paths import ROOT
from netlib.proto import prototxt, schema
from netlib.proto.messages import SolverParameter
from tools.common.arguments import parser_of
from tools.common.console import guarded

BATCH, HELD_OUT = 64, 256
FRAMES, FEW, ITERATIONS = 4096, 64, 1000
DRAWN = [0, 1, 4, 5]  # held-out frames in the picture
SOLVER = 'type: "Adam" base_lr: 0.0005 momentum: 0.9 momentum2: 0.999 lr_policy: "poly" power: 1 random_seed: 1'


def paper_net(batch: int) -> str:
    """The prototxt of the paper's training net, with an Input of the same shapes in place of
    its data layers.
    """
    text = (ROOT / "prototxt" / "nyu_train_test.prototxt").read_text(encoding="utf-8")
    text = re.sub(r'^layer {\n  name: "data".*?^}\n', "", text, flags=re.MULTILINE | re.DOTALL)
    shapes = f"shape {{ dim: {batch} dim: 1 dim: 128 dim: 128 }} shape {{ dim: {batch} dim: 93 }}"
    return f'layer {{ name: "data" type: "Input" top: "depth" top: "joint" input_param {{ {shapes} }} }} {text}'


def predict(solver: netlib.Solver, depth: Array) -> Array:
    """The joints (N, 31, 3) that the solver's network predicts, without dropout."""
    net = netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST)
    net.copy_from(solver.net)
    return joints_of(net, depth)


def new_solver(iterations: int) -> netlib.Solver:
    """The solver of the paper's training net."""
    text = f"{SOLVER} max_iter: {iterations} net_param {{ {paper_net(BATCH)} }}"
    tree = prototxt.parse(text, "five_minutes")
    return netlib.Solver(schema.read(tree, SolverParameter, "five_minutes"))


def shuffled(count: int) -> Iterator[int]:
    """The indices of all frames in a random order, then in another one, without end."""
    rng = np.random.default_rng(1)
    while True:
        yield from rng.permutation(count)


def train(count: int, iterations: int) -> list[Progress]:
    """Render and train; prints the errors at the beginning, after a hundredth of the iterations
    and each tenth.
    """
    print(f"rendering {count} + {HELD_OUT} frames")
    training = rendered("train", count)
    held_out = rendered("test", HELD_OUT)
    solver, order, course = new_solver(iterations), shuffled(count), []
    for iteration in range(iterations + 1):
        if iteration == iterations // 100 or iteration % (iterations // 10) == 0:
            course.append(measured(solver, iteration, training, held_out))
        if iteration < iterations:
            batch = list(itertools.islice(order, BATCH))
            solver.net.blobs["depth"].data[...] = training.depth[batch]
            solver.net.blobs["joint"].data[...] = training.joints[batch].reshape(BATCH, -1)
            solver.step(1)
    return course


def measured(solver: netlib.Solver, iteration: int, training: Frames, held_out: Frames) -> Progress:
    """Print the errors of the network on some frames of each kind, and return them with its drawn
    hands.
    """
    fitted = predict(solver, training.depth[:HELD_OUT])
    training_mm = error_mm(fitted, training.joints[:HELD_OUT])
    predicted = predict(solver, held_out.depth)
    held_out_mm = error_mm(predicted, held_out.joints)
    errors = f"training frames {training_mm:5.1f} mm, held-out frames {held_out_mm:5.1f} mm"
    print(f"iteration {iteration:4}   {errors}")
    return Progress(iteration, training_mm, held_out_mm, predicted[DRAWN])


def draw(course: list[Progress], path: Path) -> None:
    """Draw held-out hands over the iterations."""
    write(hands_over_time(course, rendered("test", HELD_OUT), DRAWN), path)
    print(f"wrote {path}")


def run(args: argparse.Namespace) -> int:
    """Run the command; returns the exit status."""
    if args.book:
        runs = {count: train(count, ITERATIONS) for count in (FRAMES, FEW)}
        write(errors_over_time(runs), PLACE / "by_heart.svg")
        draw(runs[FRAMES], PLACE / "learned.svg")
    else:
        draw(train(args.frames, args.iterations), args.out)
    return 0


def main(argv: list[str] | None = None) -> int:
    """Parse and run; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "--frames", type=int, default=FRAMES, help=f"training frames (default: {FRAMES})"
    )
    parser.add_argument("--iterations", type=int, default=ITERATIONS, help=f"default: {ITERATIONS}")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("five_minutes.svg"),
        help="the picture (default: %(default)s)",
    )
    parser.add_argument(
        "--book", action="store_true", help="both runs of the book; draws its two figures"
    )
    args = parser.parse_args(argv)
    if args.frames < 1 or args.iterations < 10:
        parser.error("--frames must be at least 1 and --iterations at least 10")
    return guarded(run, args)


if __name__ == "__main__":
    sys.exit(main())
