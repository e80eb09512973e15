"""Run the cases of an exercise with a part: one of this process, or the reader's in another one (process.py)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from exercises.exercise import Case, Exercise, Part, Progress, Remedy, Values, unwarned
from exercises.reading import Failure, Outline, ReadersFile, failure_of
from netlib.blob import Array


class PartError(Exception):
    """Raised if a part raises an exception; ``failure`` describes that exception."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.text)
        self.failure = failure


class Runner(Protocol):
    """A part that can be run. Its methods raise PartError if the part raises an exception."""

    @property
    def outline(self) -> Outline | None:
        """What the reader's file defines; None for a part that comes from no such file."""

    def run(self, case: Case, remedy: Remedy | None = None) -> Values:
        """Return the results of a case, computed with the part or with the part that a remedy makes of it."""

    def train(self, iterations: int, progress: Progress) -> Array:
        """Train the paper's network with the part; returns the loss of each iteration."""


def results(runner: Runner, case: Case, remedy: Remedy | None = None) -> Values:
    """Return ``runner.run(case, remedy)``. Raises PartError, also if an expected result is missing."""
    values = runner.run(case, remedy)
    if missing := [name for name in case.expected if name not in values]:
        raise PartError(Failure(f"no result for {', '.join(missing)}"))
    return values


@dataclass(frozen=True)
class LocalRunner:
    """A part of this process; ``reader`` is the file that defines it, if any."""

    exercise: Exercise
    part: Part
    reader: ReadersFile | None = None

    @property
    def outline(self) -> Outline | None:
        """What the reader's file defines."""
        return self.reader.outline if self.reader else None

    def run(self, case: Case, remedy: Remedy | None = None) -> Values:
        """Return the results of a case."""
        try:
            with unwarned():
                values = case.run(remedy.cured(self.part) if remedy else self.part)
                return {name: np.asarray(value, np.float64) for name, value in values.items()}
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # including SystemExit and the reader's own exceptions
            raise PartError(failure_of(error, self.reader)) from error

    def train(self, iterations: int, progress: Progress) -> Array:
        """Train the paper's network."""
        try:
            with unwarned():
                return np.asarray(self.exercise.train(self.part, iterations, progress), np.float64)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise PartError(failure_of(error, self.reader)) from error
