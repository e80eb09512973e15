#!/usr/bin/env python3
"""Exercises: implement a layer and check it step by step.

    python tools/exercise.py
    python tools/exercise.py relu --start
    python tools/exercise.py relu --bug 1
    python tools/exercise.py relu

The first command lists the exercises and marks those solved. --start writes relu.py into the working folder: the
project's file without the bodies to implement; with --bare also without formulas. --bug writes relu_bug1.py, the
project's file with a mistake to find. The last command checks relu.py: shapes, values against Caffe's, the gradient
against central differences, and the paper's network with it. The first difference is explained. The file is executed,
in a separate process.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import textwrap
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from exercises import process, solutions
from exercises.checking import Step
from exercises.exercise import Exercise
from exercises.reading import ExerciseError
from exercises.stubs import bugs, stub
from exercises.table import EXERCISES
from netlib.errors import did_you_mean, reason_of
from netlib.files.paths import command
from tools.common.arguments import MAX_COUNT, count, parser_of, seconds, whole
from tools.common.console import DONE, FAILED, guarded, say
from tools.common.progress import ProgressBar


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("name", metavar="NAME", nargs="?", help="the exercise; without it, list all")
    parser.add_argument("--start", action="store_true", help="write the stub NAME.py into the working folder")
    parser.add_argument("--bare", action="store_true", help="with --start: omit formulas and hints")
    parser.add_argument("--bug", type=count, metavar="N",
                        help="write NAME_bugN.py, the project's file with the Nth mistake to find")
    parser.add_argument("--file", metavar="FILE", help="file to check (default: NAME.py here)")
    parser.add_argument("--iterations", type=whole(0, MAX_COUNT), default=20, metavar="N",
                        help="iterations of the network in the last step (default: %(default)s)")
    parser.add_argument("--limit", type=seconds, default=300.0, metavar="S",
                        help="time limit of a step or an iteration (default: %(default)g)")
    args = parser.parse_args(argv)
    if args.name is not None and args.name not in EXERCISES:
        known, meant = ", ".join(EXERCISES), did_you_mean(args.name.lower(), EXERCISES)
        parser.error(f"unknown exercise {args.name!r}{meant}; known: {known}")
    if args.name is None and (args.start or args.bug or args.file is not None):
        parser.error("--start, --bug and --file need the NAME of an exercise")
    if args.bare and not args.start:
        parser.error("--bare needs --start")
    if args.bug and (args.start or args.file is not None):
        parser.error("--bug writes NAME_bugN.py; use --file to check it")
    if args.start and args.file is not None:
        parser.error("--start writes NAME.py; use --file to check it")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """List, start or check exercises."""
    if args.name is None:
        return show_all()
    exercise = EXERCISES[args.name]
    if args.start:
        return start(exercise, bare=args.bare)
    if args.bug:
        return plant(exercise, args.bug)
    path = Path(args.file) if args.file is not None else solutions.to_check(exercise)
    return check(exercise, path, args.iterations, args.limit, not args.no_python_layers)


def show_all() -> int:
    """List the exercises in the order of the book, with marks for those solved and those started."""
    passed = solutions.passed()
    for number, exercise in enumerate(EXERCISES.values(), 1):
        mark = solutions.mark(exercise, passed)
        say(f"{mark} {number:2}  {exercise.name:16} {exercise.title} (chapter {exercise.chapter})")
    say(f"Start one: {command('exercise')} relu --start")
    return DONE


def plant(exercise: Exercise, number: int) -> int:
    """Write a file with a bug. Raises ExerciseError if the bug does not exist or the file exists."""
    files, path = bugs(exercise), Path(f"{exercise.name}_bug{number}.py")
    if not 1 <= number <= len(files):
        raise ExerciseError(f"--bug {number}: {exercise.name} has {_bugs(len(files))}")
    solutions.write_new(path, files[number - 1])
    say(f"wrote {path}: bug {number} of {len(files)}. Read it, fix it, then: "
        f"{command('exercise')} {exercise.name} --file {path}")
    return DONE


def _bugs(count: int) -> str:
    return f"bugs 1 to {count}" if count > 1 else "one bug only, --bug 1" if count else "no bug to find"


def start(exercise: Exercise, *, bare: bool = False) -> int:
    """Write the stub. Raises ExerciseError if the file exists."""
    path = solutions.place(exercise)
    solutions.write_new(path, stub(exercise, bare=bare))
    say(f"wrote {path}: {exercise.title}")
    say(f"Write {', '.join(exercise.to_do)}; then: {command('exercise')} {exercise.name}")
    return DONE


def check(exercise: Exercise, path: Path, iterations: int, limit_s: float, python_layers: bool) -> int:
    """Run the checks and print each. Raises ExerciseError."""
    say(f"{exercise.title} ({path})")
    passed, checksum = False, solutions.checksum(exercise, path)  # before its code runs, which could change the file
    with contextlib.ExitStack() as stack:
        bars: list[ProgressBar] = []

        def progress(count: int) -> None:
            if not bars:
                bars.append(stack.enter_context(ProgressBar(iterations, "iterations", "training")))
            bars[0](count)

        for step in process.checked(exercise, path, iterations, limit_s, python_layers, progress):
            stack.close()  # removes the bar before the last line
            print_step(step)
            passed = step.passed
    if not passed:
        return FAILED
    if path == solutions.place(exercise):
        try:
            solutions.note(exercise, checksum)
        except OSError as error:
            say(f"{solutions.PASSED}: cannot be written, so the list will not show this: {reason_of(error)}",
                file=sys.stderr)
    say(f"Everything is correct. For comparison, the project's file: {exercise.file}")
    return DONE


def print_step(step: Step) -> None:
    """Print a step on one line, with an explanation if it failed."""
    say(f"{'✓' if step.passed else '✗'} {step.title}")
    for line in step.lines:
        for part in textwrap.wrap(line, 110, break_long_words=False, break_on_hyphens=False):
            say(f"    {part}")


if __name__ == "__main__":
    sys.exit(main())
