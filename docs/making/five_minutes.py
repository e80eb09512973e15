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
import re
import sys
from pathlib import Path

import numpy as np

import netlib
from docs.making.figures.drawing import PLACE, write
from docs.making.figures.whole import HALF_CUBE_MM, Point, errors_over_time, hands_over_time
from handpose.synthetic.generator import Generator, Split
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


def rendered(split: Split, count: int) -> tuple[Array, Array, Array]:
    """Crops (N, 1, 128, 128), joints (N, 31, 3) in half-cubes, centres (N, 3) of the first
    frames of a split.
    """
    generator = Generator(seed=0, split=split)
    blocks = [generator.block(number) for number in range(-(-count // 64))]  # of 64 frames
    depth = np.concatenate([block.depth for block in blocks])
    joints = np.concatenate([block.joint for block in blocks]).reshape(-1, 31, 3)
    center = np.concatenate([block.center_uvd for block in blocks])
    return depth[:count], joints[:count], center[:count]


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
    for name, blobs in net.params.items():
        for blob, trained in zip(blobs, solver.net.params[name]):
            blob.data[...] = trained.data
    net.blobs["depth"].reshape(*depth.shape)
    return net.forward(depth=depth)["pred"].reshape(-1, 31, 3)


def error_mm(joints: Array, truth: Array) -> float:
    """The mean distance of joints (N, 31, 3) in half-cubes."""
    return float(HALF_CUBE_MM * np.linalg.norm(joints - truth, axis=2).mean())


def train(count: int, iterations: int) -> list[Point]:
    """Render and train; prints the errors at the beginning, after a hundredth of the iterations
    and each tenth.
    """
    print(f"rendering {count} + {HELD_OUT} frames")
    (depth, joints, _), (held_out, truth, _) = rendered("train", count), rendered("test", HELD_OUT)
    tree = prototxt.parse(
        f"{SOLVER} max_iter: {iterations} net_param {{ {paper_net(BATCH)} }}", "five_minutes"
    )
    solver = netlib.Solver(schema.read(tree, SolverParameter, "five_minutes"))
    rng, points = np.random.default_rng(1), []
    order: Array = np.zeros(0, dtype=int)
    for iteration in range(iterations + 1):
        if iteration == iterations // 100 or iteration % (iterations // 10) == 0:
            predicted = predict(solver, held_out)
            training_mm = error_mm(predict(solver, depth[:HELD_OUT]), joints[:HELD_OUT])
            points.append(
                Point(iteration, training_mm, error_mm(predicted, truth), predicted[DRAWN])
            )
            print(
                "iteration {:4}   training frames {:5.1f} mm, held-out frames {:5.1f} mm".format(
                    *points[-1]
                )
            )
        while len(order) < BATCH:  # every frame once, in a new order
            order = np.concatenate([order, rng.permutation(count)])
        rows, order = order[:BATCH], order[BATCH:]
        solver.net.blobs["depth"].data[...] = depth[rows]
        solver.net.blobs["joint"].data[...] = joints[rows].reshape(BATCH, -1)
        if iteration < iterations:
            solver.step(1)
    return points


def draw(points: list[Point], path: Path) -> None:
    """Draw held-out hands over the iterations."""
    depth, joints, center = (array[DRAWN] for array in rendered("test", HELD_OUT))
    write(hands_over_time(points, depth[:, 0], center, joints), path)
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
