#!/usr/bin/env python3
"""Reproduce the paper's Table 1: train its networks in its setting, each until further training does not help.

    python tools/table1.py --hours 8

runs for a night; the next run continues where this one stopped. The hours and the disk space that are needed are
printed first. To list what is done, what is missing, and the approximate time:

    python tools/table1.py --list

The setting is one hand, with a second one for testing, as in NYU; if data/nyu holds the NYU data set, it is used.
Missing synthetic data are generated. Each network is trained with this project's recipe and the paper's solver, half as
long again each time, until that changes its error by less than 2%, or to the longest length; then from another seed;
then on hands of many people; then with other weights of PhysLimit. Every scored length is a file in docs/results/table1
and is never trained again, even if the next run is on another machine. docs/results/table1.md and its figures are
generated from these files.
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

from experiments.table1 import page as table1_page
from experiments.table1 import speed, store
from experiments.table1.networks import NETWORKS
from experiments.table1.plan import Job, lambdas, order, report
from experiments.table1.recipes import ADAM, RECIPES
from experiments.table1.settings import MANY_HANDS, ONE_HAND, REAL, SETTINGS, Setting, is_real_nyu
from layers.hand import skeleton as skeletons
from netlib.errors import NetlibError
from netlib.files import atomic
from netlib.files.paths import IS_CLONE, ROOT, command
from tools.common.arguments import MAX_HOURS, count, parser_of, real, seed, workers
from tools.common.campaign import Campaign
from tools.common.console import DONE, aligned, guarded, say
from tools.common.outputs import make_folder
from tools.common.table1_pictures import write_pictures

RESULTS = ROOT / "docs" / "results" if IS_CLONE else Path("results")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    names = [network.name for network in NETWORKS]
    parser = parser_of(__doc__, nets=True)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="do not train; list what is done and what is missing")
    what.add_argument("--page", action="store_true", help="do not train; write the page from what is done")
    what.add_argument("--speed", action="store_true", help="do not train; measure frames per second on this machine")
    parser.add_argument("--setting", choices=SETTINGS, help="only this setting (default: all, NYU if available)")
    parser.add_argument("--networks", nargs="+", choices=names, metavar="NAME",
                        help=f"only some of {', '.join(names)} (default: those needed)")
    parser.add_argument("--recipe", choices=RECIPES, help="only this recipe (default: both)")
    parser.add_argument("--seeds", type=seed, nargs="+", default=[1, 2], metavar="N", help="default: 1 2")
    parser.add_argument("--hours", type=real(0, MAX_HOURS), metavar="H", help="stop after about H hours")
    parser.add_argument("--longest", type=count, metavar="N", help="train for at most N iterations")
    parser.add_argument("--threads", type=workers, metavar="N", help="training threads (default: one per processor)")
    parser.add_argument("--ledger", type=Path, default=RESULTS / "table1", metavar="FOLDER",
                        help="folder of scored lengths (default: results/table1, in a clone in docs)")
    parser.add_argument("--work", type=Path, default=Path("snapshots/table1"), metavar="FOLDER",
                        help="folder of nets, snapshots and logs (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=RESULTS, metavar="FOLDER",
                        help="folder of the page and its figures (default: results, in a clone in docs)")
    parser.add_argument("--lambda-length", type=count, metavar="N",
                        help="iterations for other weights of PhysLimit (default: those of weight 1)")
    args = parser.parse_args(argv)
    if args.networks and not (args.page or args.speed or args.lambda_length or _jobs(args)):
        parser.error(f"--networks {' '.join(args.networks)}: that --setting and --recipe have no training of these")
    shortest = min((job.recipe.lengths[0] for job in _jobs(args)), default=0)
    if args.longest and args.longest < shortest and not (args.page or args.speed):
        parser.error(f"--longest {args.longest}: trains nothing; expected at least {shortest}, the shortest length")
    args.command = shlex.join([*command("table1").split(), *(sys.argv[1:] if argv is None else argv)])
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Train, list, measure or write the page."""
    deadline = time.monotonic() + 3600 * args.hours if args.hours is not None else float("inf")
    campaign = Campaign(args.ledger, args.work, args.command, deadline, args.longest, args.threads)
    if not args.ledger.is_dir() and (args.list or args.page or args.ledger.exists()):
        raise NetlibError(f"{args.ledger}: no such folder; expected the folder of results that --list and --page show; "
                           "--ledger FOLDER selects that of a clone, docs/results/table1")
    if args.list:
        print(aligned(report([*_jobs(args), *_lambdas(args, campaign)], campaign.store_of, args.longest)))
        return DONE
    if args.speed:
        speed.write(args.ledger / speed.WHERE, speed.measure())
    elif not args.page:
        say(campaign.cost(_jobs(args)), file=sys.stderr)
        status = campaign.run(_jobs(args))
        if status == DONE and not campaign.is_over:
            status = campaign.run(_lambdas(args, campaign))
        if status != DONE:
            return status
    _write(args)
    return DONE


def _write(args: argparse.Namespace) -> None:
    """Write the page and its figures from the results."""
    entries = {name: store.read_all(args.ledger, name) for name in SETTINGS}
    if not any(entries.values()):
        if not args.page:  # time was up before the first length was scored
            return
        raise NetlibError(f"{args.ledger}: no results yet, so there is no page; expected folders "
                          f"{' or '.join(SETTINGS)} with a file per length")
    make_folder(args.out)
    for path in write_pictures(args.out, args.ledger, entries, skeletons.load()):
        say(f"wrote {path}", file=sys.stderr)
    page = table1_page.page_of(entries, speed.read(args.ledger / speed.WHERE))
    atomic.replace_text(args.out / "table1.md", page)
    say(f"wrote {args.out / 'table1.md'}", file=sys.stderr)


def _lambdas(args: argparse.Namespace, campaign: Campaign) -> list[Job]:
    """The training runs with other weights of PhysLimit, if no networks are selected or their length is given."""
    first = _first(args)
    asked = args.lambda_length or (args.networks is None and first is not MANY_HANDS)
    recipe = RECIPES[args.recipe] if args.recipe else ADAM
    return lambdas(campaign.store_of(first), first, args.lambda_length, recipe) if asked and 1 in args.seeds else []


def _first(args: argparse.Namespace) -> Setting:
    """The setting of the paper."""
    return SETTINGS[args.setting] if args.setting else REAL if is_real_nyu() else ONE_HAND


def _jobs(args: argparse.Namespace) -> list[Job]:
    """The selected training runs."""
    recipes = [RECIPES[args.recipe]] if args.recipe else list(RECIPES.values())
    networks = args.networks and [network for network in NETWORKS if network.name in args.networks]
    return list(
        order(_first(args), None if args.setting else MANY_HANDS, networks, recipes, list(dict.fromkeys(args.seeds)))
    )


if __name__ == "__main__":
    sys.exit(main())
