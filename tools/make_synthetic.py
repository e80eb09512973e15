#!/usr/bin/env python3
"""Generate synthetic training and test data: depth crops of random hands with their joints.

    python tools/make_synthetic.py --out data/nyu --train 20000 --test 2000

writes train_000.h5, train_001.h5, ... of 2,500 frames each, test_000.h5, and the lists train.txt
and test.txt that HDF5Data layers read. Existing files with the same content are kept: a second run
returns at once, and an interrupted run continues. Data of another origin or of another body are
replaced only with --force.

--recipe nyu          NYU's camera, distances and poses: the default
         any_roll     hands rotated by any angle, 250 to 1200 mm away
         cameras      as any_roll, with hands of many people, sleeves, and Kinect, RealSense and
                      time-of-flight cameras: for training with your own camera
         people       as cameras, with adults and children, any viewpoint and any
                      direction of the arm
         in_scenes    half of them as people, half in front of, behind and next to tables, things,
                      bodies and other hands, held things included; without dof and bones
         one_hand     one hand, with NYU's orientations, and in the test split a second, smaller
                      one: the setting of the paper
         many_hands   the same poses, with hands of many people

    python tools/make_synthetic.py --body prototxt/body/person_prior.prototxt --train 40000

draws another body, as described by its prior file, into the folder of its name in data/
(docs/bodies.md).
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from handpose.synthetic import recipes
from handpose.synthetic.files import DataSet
from handpose.synthetic.generator import Generator, Recipe, Split
from netlib import engine
from netlib.errors import NetlibError
from tools.common.arguments import count, parser_of, seed, workers
from tools.common.console import DONE, duration, guarded, say
from tools.common.progress import fill_folder

HANDS = Path("data/nyu")  # where frames of hands are written by default
RECIPE = "nyu"


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "--body",
        metavar="PRIOR",
        type=Path,
        help="draw the body of this prior file instead of hands",
    )
    parser.add_argument(
        "--out",
        type=Path,
        help=f"output folder (default: {HANDS}; with --body {HANDS.parent}/ "
        "and the skeleton's name)",
    )
    parser.add_argument(
        "--train", type=count, default=20000, metavar="N", help="frames (default: %(default)s)"
    )
    parser.add_argument(
        "--test", type=count, default=2000, metavar="N", help="frames (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="random seed (default: %(default)s)"
    )
    parser.add_argument(
        "--recipe", choices=recipes.NAMES, help=f"hands and cameras (default: {RECIPE})"
    )
    parser.add_argument(
        "--workers",
        type=workers,
        default=engine.available_cpus(),
        metavar="N",
        help="processes (default: one per processor, %(default)s)",
    )
    parser.add_argument(
        "--force", action="store_true", help="replace existing data, even real data"
    )
    args = parser.parse_args(argv)
    if args.body and args.recipe:
        parser.error("--recipe applies only to hands; other bodies are described by the prior file")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Generate the missing data."""
    recipe = recipes.recipe_of(args.body) if args.body else recipes.recipe(args.recipe or RECIPE)
    if args.body:
        recipes.check_in_view(recipe, args.seed)
    out: Path = args.out or (HANDS.with_name(_name(args, recipe)) if args.body else HANDS)
    counts: dict[Split, int] = {"train": args.train, "test": args.test}
    summary = f"{out}: {args.train} train and {args.test} test frames (synthetic, seed {args.seed})"
    data = DataSet(
        out, [(Generator(args.seed, split, recipe), n) for split, n in counts.items()], args.force
    )
    if data.is_whole:
        say(f"{summary} exist already")
        return DONE
    begun = time.perf_counter()
    status = fill_folder(
        out, data.missing_frames, lambda advance: data.write(args.workers, advance)
    )
    if status == DONE:
        say(
            f"{summary}; made {data.missing_frames} of them in {duration(time.perf_counter() - begun)}"
        )
    return status


def _name(args: argparse.Namespace, recipe: Recipe) -> str:
    """The name of the body. Raises NetlibError if it cannot be a folder."""
    name = recipe.prior.body().name
    if re.fullmatch(r"\w[\w.-]*", name):
        return name
    raise NetlibError(
        f"{args.body}: its skeleton is named {name!r}, which cannot be a folder; expected --out"
    )


if __name__ == "__main__":
    sys.exit(main())
