#!/usr/bin/env python3
"""Write a layer again, and see step by step whether it is right: the exercises of docs/exercises.

    python tools/exercise.py
    python tools/exercise.py relu --start
    python tools/exercise.py relu --bug 1
    python tools/exercise.py relu

The first lists the exercises, with a tick at those that have passed here. --start writes relu.py into the working
folder: our own file, without the bodies that are to be written; with --bare without the formulas, too. --bug writes
relu_bug.py, our own file with a mistake in it, to be found. The last checks it: shapes, values against those of Caffe,
the gradient against differences, and the paper's network with it. The first difference is explained. The file is a
program: its code is run, in a process of its own.
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
from exercises.bugs import bugs
from exercises.checking import Step
from exercises.exercise import Exercise
from exercises.reading import ExerciseError
from exercises.stubs import stub
from exercises.table import EXERCISES
from netlib.errors import did_you_mean
from netlib.files.paths import command
from tools.common.arguments import natural, parser_of, positive, positive_number
from tools.common.console import DONE, FAILED, guarded, say
from tools.common.progress import ProgressBar


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("name", metavar="NAME", nargs="?", help="the exercise; without one they are listed")
    parser.add_argument("--start", action="store_true", help="write the stub, NAME.py, into the working folder")
    parser.add_argument("--bare", action="store_true", help="with --start: a stub without formulas and hints")
    parser.add_argument("--bug", type=positive, metavar="N",
                        help="write NAME_bug.py, our file with the Nth known mistake in it, to be found")  # fmt: skip
    parser.add_argument("--file", metavar="FILE",
                        help="what to check (default: NAME.py here, else in docs/exercises)")  # fmt: skip
    parser.add_argument("--iterations", type=natural, default=20, metavar="N",
                        help="of the network in the last step, 0 for none (default: %(default)s)")  # fmt: skip
    parser.add_argument("--limit", type=positive_number, default=300.0, metavar="S",
                        help="end it if a step or an iteration takes longer (default: %(default)g)")  # fmt: skip
    args = parser.parse_args(argv)
    if args.name is not None and args.name not in EXERCISES:
        known, meant = ", ".join(EXERCISES), did_you_mean(args.name.lower(), EXERCISES)
        parser.error(f"there is no exercise {args.name!r}{meant}; there are {known}")
    if args.name is None and (args.start or args.bug or args.file is not None):
        parser.error("--start, --bug and --file need the NAME of an exercise")
    if args.bare and not args.start:
        parser.error("--bare goes with --start")
    if args.bug and (args.start or args.file is not None):
        parser.error("--bug writes NAME_bug.py; give --file when you check it")
    if args.start and args.file is not None:
        parser.error("--start writes NAME.py; give --file when you check it")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """List, start or check as the parsed arguments say."""
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
    """The exercises in the order of the book; a tick at those whose file here has passed, a point at those begun."""
    passed = solutions.passed()
    for number, exercise in enumerate(EXERCISES.values(), 1):
        mark = solutions.mark(exercise, passed)
        say(f"{mark} {number:2}  {exercise.name:16} {exercise.title} (chapter {exercise.chapter})")
    say(f"Begin one: {command('exercise')} relu --start")
    return DONE


def plant(exercise: Exercise, number: int) -> int:
    """Write our file with a bug. Raises ExerciseError if there is no such bug, or the file is there."""
    files, path = bugs(exercise), Path(f"{exercise.name}_bug.py")
    if not 1 <= number <= len(files):
        raise ExerciseError(f"{exercise.name} has {len(files)} bugs to find; there is no bug {number}")
    solutions.write_new(path, files[number - 1])
    say(f"wrote {path}: bug {number} of {len(files)}. Read it, fix it, then: "
        f"{command('exercise')} {exercise.name} --file {path}")  # fmt: skip
    return DONE


def start(exercise: Exercise, *, bare: bool = False) -> int:
    """Write the stub. Raises ExerciseError if the file is there."""
    path = solutions.place(exercise)
    solutions.write_new(path, stub(exercise, bare=bare))
    say(f"wrote {path}: {exercise.title}")
    say(f"Write {', '.join(exercise.to_do)}; then: {command('exercise')} {exercise.name}")
    return DONE


def check(exercise: Exercise, path: Path, iterations: int, limit_s: float, python_layers: bool) -> int:
    """Make the steps and tell each. Raises ExerciseError."""
    say(f"{exercise.title} ({path})")
    passed = False
    with contextlib.ExitStack() as stack:
        bar = None
        for news in process.checked(exercise, path, iterations, limit_s, python_layers):
            if isinstance(news, Step):
                stack.close()  # the bar goes before the last line comes
                tell(news)
                passed = news.passed
                continue
            bar = bar or stack.enter_context(ProgressBar(iterations, "iterations", "training"))
            bar(news)
    if not passed:
        return FAILED
    if path == solutions.place(exercise):
        solutions.note(exercise)
    say(f"All of it is right. Ours, to compare: {exercise.file}")
    return DONE


def tell(step: Step) -> None:
    """A step in one line; one that failed in a few."""
    say(f"{'✓' if step.passed else '✗'} {step.title}")
    for line in step.lines:
        for part in textwrap.wrap(line, 110, break_long_words=False, break_on_hyphens=False):
            say(f"    {part}")


if __name__ == "__main__":
    sys.exit(main())
