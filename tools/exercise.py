#!/usr/bin/env python3
"""Exercises: implement a layer and check it step by step.

    python tools/exercise.py
    python tools/exercise.py relu --start
    python tools/exercise.py relu --bug 1
    python tools/exercise.py relu

The first command lists the exercises and marks those started. --start writes relu.py into the
working folder: the project's file without the bodies to implement. --bug writes relu_bug1.py, the
project's file with a mistake to find. The last command checks relu.py: shapes, values against
Caffe's, the gradient against central differences, the options one after the other, and the paper's
network with it. The first difference is explained. The file is executed, in a separate process.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from exercises import solutions
from exercises.table import EXERCISES
from netlib.errors import did_you_mean
from tools.common.arguments import MAX_COUNT, count, parser_of, seconds, whole
from tools.common.commands import command
from tools.common.console import DONE, FAILED, guarded


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument(
        "name", metavar="NAME", nargs="?", help="the exercise; without it, list all"
    )
    does = parser.add_mutually_exclusive_group()
    does.add_argument(
        "--start", action="store_true", help="write the stub NAME.py into the working folder"
    )
    does.add_argument(
        "--bug",
        type=count,
        metavar="N",
        help="write NAME_bugN.py, the project's file with the Nth mistake to find",
    )
    does.add_argument(
        "--file", metavar="FILE", type=Path, help="file to check (default: NAME.py here)"
    )
    parser.add_argument(
        "--iterations",
        type=whole(0, MAX_COUNT),
        default=20,
        metavar="N",
        help="iterations of the network in the last step (default: %(default)s)",
    )
    parser.add_argument(
        "--limit",
        type=seconds,
        default=600.0,
        metavar="S",
        help="time limit of a check (default: %(default)g)",
    )
    args = parser.parse_args(argv)
    if args.name is not None and args.name not in EXERCISES:
        known = ", ".join(EXERCISES)
        meant = did_you_mean(args.name.lower(), EXERCISES)
        parser.error(f"unknown exercise {args.name!r}{meant}; known: {known}")
    if args.name is None and (args.start or args.bug or args.file is not None):
        parser.error("--start, --bug and --file need the NAME of an exercise")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """List, start or check exercises."""
    exercise = EXERCISES.get(args.name)
    typed = command("exercise")
    if exercise is None:
        solutions.show_all(typed)
    elif args.start:
        solutions.start(exercise, typed)
    elif args.bug:
        solutions.plant(exercise, args.bug, typed)
    else:
        passed = solutions.check(exercise, args.file, args.iterations, args.limit, typed)
        return DONE if passed else FAILED
    return DONE


if __name__ == "__main__":
    sys.exit(main())
