#!/usr/bin/env python3
"""The paper's Table 1, decided: its networks in its own setting, each trained until it stops mattering.

    python tools/table1.py --hours 8

goes on for a night, and the next run goes on where this one stopped. What is done, what is missing, and about how long
that takes, says

    python tools/table1.py --list

The setting is one hand, and a second one to test on, as in NYU; where data/nyu holds NYU itself, it is NYU. Missing
synthetic data are made. Each network is trained by our recipe and by the paper's solver, half as long again each time,
until that changes its error by less than 2%, or to the longest length; then from another seed; then on hands of many
people; then with other weights of PhysLimit. Every length that was scored is a file in docs/results/table1: it is never
trained again, on whatever machine the next run is. docs/results/table1.md and its pictures are written from these
files.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from handpose.experiments.table1 import ledger, speed
from handpose.experiments.table1 import page as table1_page
from handpose.experiments.table1.networks import NETWORKS
from handpose.experiments.table1.plan import Job, lambdas, order, report
from handpose.experiments.table1.recipes import ADAM, RECIPES
from handpose.experiments.table1.settings import MANY_HANDS, ONE_HAND, REAL, SETTINGS, Setting, is_real_nyu
from layers.hand import skeleton as skeletons
from netlib.errors import NetlibError
from netlib.files import atomic
from netlib.files.paths import IS_CLONE, ROOT, command
from tools.common.arguments import natural, parser_of, positive, weight
from tools.common.console import DONE, aligned, guarded, say
from tools.common.pictures import make_folder
from tools.common.sitting import Sitting
from tools.common.table1_pictures import write_pictures

RESULTS = ROOT / "docs" / "results" if IS_CLONE else Path("results")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    names = [network.name for network in NETWORKS]
    parser = parser_of(__doc__, nets=True)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="train nothing, say what is done and what is missing")
    what.add_argument("--page", action="store_true", help="train nothing, write the page from what is done")
    what.add_argument("--speed", action="store_true", help="train nothing, measure frames per second on this machine")
    parser.add_argument("--setting", choices=SETTINGS, help="only this one (default: all, NYU if it is there)")
    parser.add_argument("--networks", nargs="+", choices=names, metavar="NAME",
                        help=f"only these of {', '.join(names)} (default: those that a question hangs on)")  # fmt: skip
    parser.add_argument("--recipe", choices=RECIPES, help="only this one (default: both)")
    parser.add_argument("--seeds", type=natural, nargs="+", default=[1, 2], metavar="N", help="default: 1 2")
    parser.add_argument("--hours", type=weight, metavar="H", help="end after about so many hours")
    parser.add_argument("--longest", type=positive, metavar="N", help="train for no more than N iterations")
    parser.add_argument("--threads", type=positive, metavar="N", help="of training (default: one per processor)")
    parser.add_argument("--ledger", type=Path, default=RESULTS / "table1", metavar="FOLDER",
                        help="where scored lengths are kept (default: results/table1, of a clone in docs)")  # fmt: skip
    parser.add_argument("--work", type=Path, default=Path("snapshots/table1"), metavar="FOLDER",
                        help="where nets, snapshots and logs go (default: %(default)s)")  # fmt: skip
    parser.add_argument("--out", type=Path, default=RESULTS, metavar="FOLDER",
                        help="where the page and its pictures go (default: results, of a clone in docs)")  # fmt: skip
    parser.add_argument("--lambda-length", type=positive, metavar="N",
                        help="iterations by weight of PhysLimit (default: where ours was done)")  # fmt: skip
    args = parser.parse_args(argv)
    if args.networks and not (args.page or args.speed or args.lambda_length or _jobs(args)):
        parser.error(f"--networks {' '.join(args.networks)}: no training of that --setting and --recipe is of these")
    args.command = shlex.join([*command("table1").split(), *(sys.argv[1:] if argv is None else argv)])
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Do what the parsed arguments say."""
    deadline = time.monotonic() + 3600 * args.hours if args.hours is not None else float("inf")
    sitting = Sitting(args.ledger, args.work, args.command, deadline, args.longest, args.threads)
    if not args.ledger.is_dir() and (args.list or args.page or args.ledger.exists()):
        raise NetlibError(f"{args.ledger}: no such folder; expected the ledger, whose files --list and --page show; "
                           "--ledger FOLDER names that of a clone, docs/results/table1")  # fmt: skip
    if args.list:
        print(aligned(report([*_jobs(args), *_lambdas(args, sitting)], sitting.ledger_of, args.longest)))
        return DONE
    if args.speed:
        speed.write(args.ledger / speed.WHERE, speed.measure())
    elif not args.page:
        status = sitting.run(_jobs(args))
        if status == DONE and not sitting.is_over:
            status = sitting.run(_lambdas(args, sitting))
        if status != DONE:
            return status
    _write(args)
    return DONE


def _write(args: argparse.Namespace) -> None:
    """The page and its pictures, from the ledger."""
    entries = {name: ledger.read_all(args.ledger, name) for name in SETTINGS}
    if not any(entries.values()):
        if not args.page:  # the time was over before the first length was scored
            return
        raise NetlibError(f"{args.ledger}: holds no training yet, so there is no page; expected "
                          f"{' or '.join(SETTINGS)} in it, with a file for each length")  # fmt: skip
    make_folder(args.out)
    for path in write_pictures(args.out, args.ledger, entries, skeletons.load()):
        say(f"wrote {path}", file=sys.stderr)
    page = table1_page.page_of(entries, speed.read(args.ledger / speed.WHERE))
    atomic.replace_text(args.out / "table1.md", page)
    say(f"wrote {args.out / 'table1.md'}", file=sys.stderr)


def _lambdas(args: argparse.Namespace, sitting: Sitting) -> list[Job]:
    """The trainings by weights of PhysLimit, if no networks are named, or it is said how long they are."""
    first = _first(args)
    asked = args.lambda_length or (args.networks is None and first is not MANY_HANDS)
    recipe = RECIPES[args.recipe] if args.recipe else ADAM
    return lambdas(sitting.ledger_of(first), first, args.lambda_length, recipe) if asked and 1 in args.seeds else []


def _first(args: argparse.Namespace) -> Setting:
    """The setting that is the paper's."""
    return SETTINGS[args.setting] if args.setting else REAL if is_real_nyu() else ONE_HAND


def _jobs(args: argparse.Namespace) -> list[Job]:
    """The trainings that are asked for."""
    recipes = [RECIPES[args.recipe]] if args.recipe else list(RECIPES.values())
    networks = args.networks and [network for network in NETWORKS if network.name in args.networks]
    return list(
        order(_first(args), None if args.setting else MANY_HANDS, networks, recipes, list(dict.fromkeys(args.seeds)))
    )


if __name__ == "__main__":
    sys.exit(main())
