"""The reader's solutions in the working folder, and which of them have passed.

The file .exercises.json there has the checksums of those that have, by exercise.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from exercises.exercise import Exercise
from exercises.reading import ExerciseError
from handpose.data.json_fields import parsed
from netlib import files
from netlib.errors import NetlibError
from netlib.files import atomic
from netlib.files.paths import ROOT, command, exists

PASSED = Path(".exercises.json")


def place(exercise: Exercise) -> Path:
    """The reader's file in the working folder."""
    return Path(f"{exercise.name}.py")


def write_new(path: Path, text: str) -> None:
    """Write a file; one that is there is the reader's work, and stays. Raises ExerciseError."""
    if exists(path) or path.is_symlink():
        raise ExerciseError(f"{path}: is there already, and stays as it is; remove it to begin anew")
    atomic.replace_text(path, text)


def to_check(exercise: Exercise) -> Path:
    """The solution here, else that of the project. Raises ExerciseError if there is neither."""
    here, there = place(exercise), ROOT / "docs" / "exercises" / f"{exercise.name}.py"
    for path in (here, there):
        if exists(path):
            return path
    raise ExerciseError(f"{here}: is not there; {command('exercise')} {exercise.name} --start writes one")


def mark(exercise: Exercise, passed: dict[str, str]) -> str:
    """A tick if the solution here is one that has passed, a point if it is another one, a space if there is none."""
    if not exists(place(exercise)):
        return " "
    return "✓" if passed.get(exercise.name) == _checksum(exercise) else "·"


def note(exercise: Exercise) -> None:
    """The solution here has passed."""
    atomic.replace_text(PASSED, json.dumps(passed() | {exercise.name: _checksum(exercise)}, indent=1) + "\n")


def passed() -> dict[str, str]:
    """The checksums by exercise; none if the file is not there or not readable."""
    try:
        found = parsed(files.read_text(PASSED, "the list of exercises"), str(PASSED))
    except NetlibError:
        return {}
    return found if isinstance(found, dict) else {}


def _checksum(exercise: Exercise) -> str:
    return hashlib.sha256(place(exercise).read_bytes()).hexdigest()
