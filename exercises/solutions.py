"""The reader's solutions in the working directory, and a record of those that have passed.

The file .exercises.json there maps an exercise to the checksum of its passed solution.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from exercises.exercise import Exercise
from exercises.reading import MAX_BYTES, ExerciseError
from handpose.frames.json_fields import parsed
from netlib import files
from netlib.errors import NetlibError
from netlib.files import atomic
from netlib.files.paths import command, exists

PASSED = Path(".exercises.json")


def place(exercise: Exercise) -> Path:
    """Return the path of the reader's file in the working directory."""
    return Path(f"{exercise.name}.py")


def write_new(path: Path, text: str) -> None:
    """Write a file. Raises ExerciseError if it exists, as it is the reader's work."""
    if exists(path) or path.is_symlink():
        raise ExerciseError(f"{path}: already exists and is kept; remove it to start again")
    atomic.replace_text(path, text)


def to_check(exercise: Exercise) -> Path:
    """Return the solution in the working directory. Raises ExerciseError if there is none."""
    path = place(exercise)
    if exists(path):
        return path
    raise ExerciseError(f"{path}: not found; run {command('exercise')} {exercise.name} --start to create it")


def mark(exercise: Exercise, passed: dict[str, Any]) -> str:
    """Return a tick if the solution has passed, a dot if it has not or was changed since, a space if there is none.

    Something other than a regular file is no solution.
    """
    try:
        same = passed.get(exercise.name) == checksum(exercise, place(exercise))
    except ExerciseError:
        return "·" if _is_file(place(exercise)) else " "
    return "✓" if same else "·"


def note(exercise: Exercise, checksum: str) -> None:
    """Record that the solution with this checksum has passed. Raises OSError."""
    atomic.replace_text(PASSED, json.dumps(passed() | {exercise.name: checksum}, indent=1) + "\n")


def passed() -> dict[str, Any]:
    """Return the checksums by exercise; empty if the file is missing or unreadable."""
    try:
        found = parsed(files.read_text(PASSED, "the list of exercises", limit=MAX_BYTES), str(PASSED))
    except NetlibError:
        return {}
    return found if isinstance(found, dict) else {}


def checksum(exercise: Exercise, path: Path) -> str:
    """Return the checksum of a solution. Raises ExerciseError if it cannot be read."""
    return hashlib.sha256(files.read_bytes(path, f"the exercise {exercise.name}", ExerciseError, MAX_BYTES)).hexdigest()


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        return False
