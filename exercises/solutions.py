"""The reader's solutions in the working directory: list them, start one, plant a
mistake, check one.

``command`` is the command line of the exercises, as the user starts it, for texts that name it.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

from exercises.check import FAILED, PASSED
from exercises.exercise import Exercise, ExerciseError
from exercises.stubs import bugs, stub
from exercises.table import EXERCISES
from netlib.errors import printable
from netlib.files import atomic
from netlib.files.paths import exists

CHECK = Path(__file__).with_name("check.py")
SPARE_S = 2  # time after the limit until check.py ends itself


def show_all(command: str) -> None:
    """List the exercises in the order of the book, with a mark for those whose file exists."""
    for number, exercise in enumerate(EXERCISES.values(), 1):
        mark = "·" if exists(place(exercise)) else " "
        about = f"{exercise.title} (chapter {exercise.chapter})"
        print(f"{mark} {number:2}  {exercise.name:16} {about}")
    print(f"Start one: {command} relu --start")


def start(exercise: Exercise, command: str) -> None:
    """Write the stub. Raises ExerciseError if the file exists."""
    path = place(exercise)
    _write_new(path, stub(exercise, command))
    print(f"wrote {path}: {exercise.title}")
    print(f"Write {', '.join(exercise.to_do)}; then: {command} {exercise.name}")


def plant(exercise: Exercise, number: int, command: str) -> None:
    """Write a file with a mistake to find.

    Raises ExerciseError if there is no such mistake or the file exists.
    """
    texts = bugs(exercise, command)
    path = Path(f"{exercise.name}_bug{number}.py")
    if number > len(texts):
        raise ExerciseError(f"--bug {number}: {exercise.name} has bugs 1 to {len(texts)}")
    _write_new(path, texts[number - 1])
    print(
        f"wrote {path}: bug {number} of {len(texts)}. Read it, fix it, then: "
        f"{command} {exercise.name} --file {path}"
    )


def check(
    exercise: Exercise, path: Path | None, iterations: int, limit_s: float, command: str
) -> bool:
    """Check a file, by default the one in the working directory, and print the result; returns
    whether it passed.

    Raises ExerciseError, also if the check does not end within ``limit_s`` seconds.
    """
    path = path or place(exercise)
    if not exists(path):
        start_it = f"; run {command} {exercise.name} --start to create it"
        raise ExerciseError(f"{path}: not found{start_it if path == place(exercise) else ''}")
    print(printable(f"{exercise.title} ({path})"), flush=True)
    passed = _passes(exercise, path, iterations, limit_s)
    if passed:
        print(f"Everything is correct. For comparison, the project's file: {exercise.file}")
    return passed


def _passes(exercise: Exercise, path: Path, iterations: int, limit_s: float) -> bool:
    """Run check.py, which prints the steps, in a process; returns whether the file passed."""
    words = (exercise.name, path, iterations, int(limit_s) + SPARE_S)
    try:
        status = subprocess.run(
            [sys.executable, CHECK, *map(str, words)], timeout=limit_s, check=False
        ).returncode
    except subprocess.TimeoutExpired:
        raise ExerciseError(
            f"{path}: not finished after {limit_s:g} s; look for an endless loop, or use a larger "
            "--limit"
        ) from None
    if status not in (PASSED, FAILED):
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"status {status}"
        raise ExerciseError(
            f"{path}: the check ended with {how}: the code crashed, or ended the process"
        )
    return status == PASSED


def place(exercise: Exercise) -> Path:
    """Return the path of the reader's file in the working directory."""
    return Path(f"{exercise.name}.py")


def _write_new(path: Path, text: str) -> None:
    if exists(path) or path.is_symlink():
        raise ExerciseError(f"{path}: already exists and is kept; remove it to start again")
    atomic.replace_text(path, text)
