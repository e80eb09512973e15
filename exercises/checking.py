"""Run the steps of an exercise, stopping at the first that fails, with an explanation."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from exercises import network
from exercises.exercise import Case, Check, Exercise, Part, Progress, agree, first_difference, unwarned
from exercises.explaining import advice, sentences, tried
from exercises.reading import ReadersFile, describe
from netlib.errors import NetlibError

ADVICE = (
    "The part passed the earlier steps on small examples but fails in the network: a size, an option or a second batch "
    "that the examples do not cover. Look for values that your code keeps from one call to the next."
)


@dataclass(frozen=True)
class Step:
    """The result of a step: its title, whether it passed, and the lines of explanation."""

    title: str
    passed: bool
    lines: tuple[str, ...] = ()


def first_step(exercise: Exercise, reader: ReadersFile) -> Step:
    """List what the reader's file defines. Unwritten functions fail the step that needs them, not this one."""
    to_do = [f"{name} (line {line})" for name, line in reader.to_do.items() if name in reader.needed]
    lines = (f"not yet written: {', '.join(to_do)}",) if to_do else ()
    return Step(f"the file has {', '.join(exercise.names)}", True, lines)


def steps(exercise: Exercise, part: Part, reader: ReadersFile | None = None) -> Iterator[Step]:
    """Run the steps before the last, up to the first failure. ``reader`` is the file that defines the part."""
    for check in exercise.checks:
        step = _checked(exercise, check, part, reader)
        yield step
        if not step.passed:
            return


def _checked(exercise: Exercise, check: Check, part: Part, reader: ReadersFile | None) -> Step:
    """Run the cases of a step."""
    for case in check.cases:
        try:
            with unwarned():
                found = first_difference(case, case.run(part), case.wanted(part))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # including SystemExit and the reader's own exceptions
            lines = [*_explain_error(case, error, reader), *_known_mistake(exercise, check, part, error)]
            return Step(check.title, False, tuple(lines))
        if found is not None:
            lines = list(sentences(exercise, part, found))
            return Step(check.title, False, (*lines, *_place(case, reader)))
    return Step(check.title, True)


def _explain_error(case: Case, error: BaseException, reader: ReadersFile | None) -> Iterator[str]:
    """Yield lines that explain an exception in the reader's code."""
    where = reader.where(error) if reader else None
    if isinstance(error, NotImplementedError):
        name = reader.function_at(error) if reader else None
        yield f"{name or case.method} is not written yet" + (f": {where}" if where else ".")
        return
    yield f"{where or 'error'}: {error if isinstance(error, NetlibError) else describe(error)}"
    if isinstance(error, AttributeError) and re.search("no setter|can't set", str(error)):
        yield "data and diff are arrays that other layers share: write into them, with [...] = on the left."
    if reader and not where:
        yield f"It was raised outside {reader.path}: check what your code returns and how it changes its arguments."
    if case.title:
        yield f"The input was: {case.title}."


def _known_mistake(exercise: Exercise, check: Check, part: Part, error: BaseException) -> Iterator[str]:
    """Yield advice for a known mistake that another case of the step reveals as a wrong value."""
    if isinstance(error, NotImplementedError):
        return
    for case in check.cases:
        if text := tried(functools.partial(_known_advice, exercise, case, part)):
            yield f"With {case.title}: {text}"
            return


def _known_advice(exercise: Exercise, case: Case, part: Part) -> str | None:
    found = first_difference(case, case.run(part), case.wanted(part))
    return advice(exercise, part, found) if found else None


def _place(case: Case, reader: ReadersFile | None) -> Sequence[str]:
    name = next((name for name in reader.lines if name.split(".")[-1] == case.method), None) if reader else None
    return [f"See {name}, {reader.path}:{reader.lines[name]}."] if reader and name else []


def in_network(
    exercise: Exercise,
    part: Part,
    iterations: int,
    reader: ReadersFile | None = None,
    progress: Progress = lambda count: None,
) -> Step:
    """Run the last step: train the paper's network with the part and compare the losses with the reference."""
    title = exercise.last.format(iterations)
    try:
        expected = np.array(network.reference_losses(iterations))
        with unwarned():
            found = exercise.train(part, iterations, progress)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        where = reader.where(error.__cause__ or error) if reader else None
        text = error if isinstance(error, NetlibError) else describe(error)
        return Step(title, False, (f"{where or 'error'}: {text}",))
    wrong = np.flatnonzero(~agree(found, expected, exercise.drift))
    if len(wrong):
        i = int(wrong[0])
        return Step(title, False, (
            f"The loss of iteration {i} is {found[i]:.6g}, expected {expected[i]:.6g}.",
            ADVICE,
        ))  # fmt: skip
    return Step(f"{title} ({found[0]:.4f} → {found[-1]:.4f})", True)
