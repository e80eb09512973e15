"""Check a reader's file: the steps of an exercise, up to the first that fails, with an explanation.

    python exercises/check.py NAME FILE ITERATIONS LIMIT_S

solutions.py runs this as a process with a time limit, because the reader's code may loop without
end or crash. The exit status is PASSED or FAILED; Python itself ends with neither of them. What the
reader's code prints goes to stderr.
"""

from __future__ import annotations

import ast
import contextlib
import re
import signal
import sys
import textwrap
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it without a traceback
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    import netlib  # noqa: F401  before NumPy: it chooses BLAS kernels

import numpy as np

from exercises import network
from exercises.exercise import (
    Case,
    Check,
    Exercise,
    ExerciseError,
    Part,
    agree,
    first_difference,
    module_of,
)
from exercises.explaining import is_right, sentences, tried
from netlib import files
from netlib.errors import NetlibError, printable, reason_of

PASSED, FAILED = 64, 65
SHAPE_ERROR = re.compile("broadcast|mismatch in its core dimension|not aligned")  # of NumPy
ADVICE = (
    "The part passed the earlier steps on small examples but fails in the network: a size, an option or a second batch "
    "that the examples do not cover. Look for values that your code keeps from one call to the next."
)


@dataclass(frozen=True)
class Step:
    """The result of a step: its title, and the lines that explain a failure, none if it passed."""

    title: str
    lines: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether there is nothing to explain."""
        return not self.lines

    def report(self) -> str:
        """Return the printed lines."""
        wrapper = textwrap.TextWrapper(
            114, "    ", "    ", break_long_words=False, break_on_hyphens=False
        )
        head = f"{'✓' if self.passed else '✗'} {self.title}"
        return "\n".join([head, *(wrapper.fill(printable(line)) for line in self.lines)])


# ---------------------------------------------------------------------------------------- the steps


def steps(exercise: Exercise, part: Part, path: Path | None = None) -> Iterator[Step]:
    """Run the steps before the last, up to the first that fails.

    ``path`` is the file of the part.
    """
    for check in exercise.checks:
        step = Step(check.title, tuple(_failure(exercise, check, part, path)))
        yield step
        if not step.passed:
            return


def _failure(exercise: Exercise, check: Check, part: Part, path: Path | None) -> Iterator[str]:
    """Yield the lines that explain the first case that fails, if any."""
    for case in check.cases:
        difference = None
        try:
            difference = first_difference(case, case.results(part))
        except BaseException as error:  # including SystemExit and the reader's own exceptions
            lines = _of_error(error, check, case, path)
        else:
            if difference is None:
                continue
            lines = sentences(exercise, check, part, difference)
        yield next(lines)  # what differs or was raised; advice follows
        if check.option:
            yield _handled_options(exercise, check, case, part)
        yield from lines
        if path and difference and (line := _line_of(case.method, path)):
            yield f"See {case.method}, {path}:{line}."
        return


def _handled_options(exercise: Exercise, check: Check, failed: Case, part: Part) -> str:
    """Describe with which options the part passes and which it does not handle."""
    passed: list[str] = []
    missing: list[str] = []
    for other in exercise.checks:
        if other.option and other is not check:
            is_passed = all(is_right(case, tried(case, part)) for case in other.cases)
            (passed if is_passed else missing).append(other.option)
    passed_cases = check.cases[: check.cases.index(failed)]
    is_first = all(case.method == failed.method for case in passed_cases)
    and_with = f" and with {', '.join(passed)}" if passed else ""
    where = "" if is_first else f" in {failed.method}"
    nor = f", nor {', '.join(missing)}" if missing else ""
    return f"This passes without options{and_with}; {check.option} is not handled{where}{nor}."


def in_network(exercise: Exercise, part: Part, iterations: int, path: Path | None = None) -> Step:
    """Run the last step: train the paper's network with the part and compare the losses with
    the reference.
    """
    title = exercise.last.format(iterations)
    expected = network.reference_losses(iterations)
    try:
        found = exercise.losses(part, iterations)
    except BaseException as error:
        return Step(title, (_described(error, path),))
    wrong = np.flatnonzero(~agree(found, expected, exercise.drift))
    if len(wrong):
        i = int(wrong[0])
        line = f"The loss of iteration {i} is {found[i]:.6g}, expected {expected[i]:.6g}."
        return Step(title, (line, ADVICE))
    return Step(f"{title} ({found[0]:.4f} → {found[-1]:.4f})")


# --------------------------------------------------------------------------------------- exceptions


def _of_error(error: BaseException, check: Check, case: Case, path: Path | None) -> Iterator[str]:
    """Yield lines that explain an exception in the reader's code."""
    yield _described(error, path)
    if isinstance(error, NotImplementedError):
        return
    if isinstance(error, AttributeError) and re.search("no setter|can't set", str(error)):
        yield "data and diff are arrays that other layers share: write into them, with [...] = or [...] += on the left."
    if hint := case.hint or check.hint:
        yield hint
    elif not check.option and SHAPE_ERROR.search(str(error)):
        yield (
            "The shapes do not fit. Write the axes of each array next to it: a factor may need a transpose, "
            "swapaxes(1, 2) if the first axis is the group or the image, or another axis in a sum."
        )
    yield f"The input was: {case.title}."


def _described(error: BaseException, path: Path | None) -> str:
    """Describe an exception on one line, with the reader's line that raised it."""
    frames = _frames(error, path) or (_frames(error.__cause__, path) if error.__cause__ else [])
    last = frames[-1] if frames else None
    if isinstance(error, NotImplementedError) and last:
        return f"{last.name} is not written yet: {path}:{last.lineno}."
    described = reason_of(error).strip().split("\n")[0]
    if not isinstance(error, NetlibError):
        described = f"{type(error).__name__}: {described}".removesuffix(": ")
    if last:
        return f"{path}:{last.lineno} ({last.line}): {described}"
    return f"{path}: {described}" if path else described


def _frames(error: BaseException, path: Path | None) -> list[traceback.FrameSummary]:
    """Return the frames of an exception in the reader's file."""
    return [
        frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)
    ]


def _line_of(function: str, path: Path) -> int | None:
    """Return the line of the first function or method with this name; None if there is none."""
    tree = ast.parse(files.read_text(path, "the exercise"))
    lines = [
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.name == function
    ]
    return min(lines, default=None)


# -------------------------------------------------------------------------------------- the process


def loaded(exercise: Exercise, path: Path) -> Part:
    """Execute the reader's file and return the part. Raises ExerciseError."""
    text = files.read_text(path, f"the exercise {exercise.name}", ExerciseError)
    try:
        part = module_of(text, str(path), f"solution of {exercise.name}")
    except SyntaxError as error:
        raise ExerciseError(f"{path}:{error.lineno or 1}: {error.msg}") from error
    except BaseException as error:  # including SystemExit and the reader's own exceptions
        raise ExerciseError(_described(error, path)) from error
    names = dict.fromkeys(name.split(".")[0] for name in exercise.to_do)
    missing = [name for name in names if not hasattr(part, name)]
    if missing:
        raise ExerciseError(
            f"{path}: {', '.join(missing)} missing; keep the names of the stub that --start writes"
        )
    return part


def main(name: str, path: str, iterations: str, limit_s: str) -> int:
    """Check a file and print the result of each step; returns PASSED or FAILED."""
    from exercises.table import EXERCISES

    if hasattr(signal, "alarm"):
        # ends this process even if the one with the time limit was killed
        signal.alarm(int(limit_s))
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    exercise, file, out = EXERCISES[name], Path(path), sys.stdout
    with contextlib.redirect_stdout(sys.stderr):
        try:
            part = loaded(exercise, file)
        except NetlibError as error:
            print(printable(error), file=sys.stderr)
            return FAILED
        for step in steps(exercise, part, file):
            print(step.report(), file=out, flush=True)
        if step.passed and int(iterations):
            step = in_network(exercise, part, int(iterations), file)
            print(step.report(), file=out)
    return PASSED if step.passed else FAILED


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
