"""The steps of an exercise: each is passed, or says what is wrong, and then no other follows."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from exercises import network
from exercises.exercise import Case, Check, Exercise, Part, Tell, agree, first_difference, unwarned
from exercises.explaining import advice, sentences, tried
from exercises.reading import ReadersFile, told
from netlib.errors import NetlibError

ADVICE = (
    "What passed the steps before on small examples is wrong on the network's: a size, an option or a second batch "
    "that they do not have. Look for numbers that your code keeps from one call to the next."
)


@dataclass(frozen=True)
class Step:
    """A step that was made: what it was, whether it is passed, and what there is to say of it."""

    title: str
    passed: bool
    lines: tuple[str, ...] = ()


def first_step(exercise: Exercise, reader: ReadersFile) -> Step:
    """What the reader's file has. What is still to be written stops the step that needs it, not this one."""
    to_do = [f"{name} (line {line})" for name, line in reader.to_do.items() if name in reader.needed]
    lines = (f"still to be written: {', '.join(to_do)}",) if to_do else ()
    return Step(f"the file has {', '.join(exercise.names)}", True, lines)


def steps(exercise: Exercise, part: Part, reader: ReadersFile | None = None) -> Iterator[Step]:
    """Make the steps before the last, up to the first that fails. ``reader`` is the file that the part comes from."""
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
        except BaseException as error:  # SystemExit, or one of the reader's own
            lines = [*_stopped(case, error, reader), *_elsewhere(exercise, check, part, error)]
            return Step(check.title, False, tuple(lines))
        if found is not None:
            lines = list(sentences(exercise, part, found))
            return Step(check.title, False, (*lines, *_place(case, reader)))
    return Step(check.title, True)


def _stopped(case: Case, error: BaseException, reader: ReadersFile | None) -> Iterator[str]:
    """What to say of an error in the reader's code."""
    where = reader.where(error) if reader else None
    if isinstance(error, NotImplementedError):
        name = reader.function_at(error) if reader else None
        yield f"{name or case.method} is still to be written" + (f": {where}" if where else ".")
        return
    yield f"{where or 'error'}: {error if isinstance(error, NetlibError) else told(error)}"
    if isinstance(error, AttributeError) and re.search("no setter|can't set", str(error)):
        yield "data and diff are arrays that others hold, too: write into them, with [...] = on the left."
    if reader and not where:
        yield f"It was raised outside of {reader.path}: look at what yours returns, and what it does to its arguments."
    if case.title:
        yield f"It happened with {case.title}."


def _elsewhere(exercise: Exercise, check: Check, part: Part, error: BaseException) -> Iterator[str]:
    """What is said of a known mistake that shows as a number in another case, where this one has stopped."""
    if isinstance(error, NotImplementedError):
        return
    for case in check.cases:
        if said := tried(functools.partial(_known_advice, exercise, case, part)):
            yield f"And with {case.title}: {said}"
            return


def _known_advice(exercise: Exercise, case: Case, part: Part) -> str | None:
    found = first_difference(case, case.run(part), case.wanted(part))
    return advice(exercise, part, found) if found else None


def _place(case: Case, reader: ReadersFile | None) -> Sequence[str]:
    name = next((name for name in reader.lines if name.split(".")[-1] == case.method), None) if reader else None
    return [f"Look at {name}, {reader.path}:{reader.lines[name]}."] if reader and name else []


def in_network(
    exercise: Exercise,
    part: Part,
    iterations: int,
    reader: ReadersFile | None = None,
    tell: Tell = lambda count: None,
) -> Step:
    """The last step: train the paper's network with the part in it, and compare the losses with ours."""
    title = exercise.last.format(iterations)
    try:
        ours = np.array(network.our_losses(iterations))
        with unwarned():
            found = exercise.train(part, iterations, tell)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        where = reader.where(error.__cause__ or error) if reader else None
        return Step(title, False, (f"{where or 'error'}: {error if isinstance(error, NetlibError) else told(error)}",))
    wrong = np.flatnonzero(~agree(found, ours, exercise.drift))
    if len(wrong):
        i = int(wrong[0])
        return Step(title, False, (
            f"The loss of iteration {i} is {found[i]:.6g}, with our own it is {ours[i]:.6g}.",
            ADVICE,
        ))  # fmt: skip
    return Step(f"{title} ({found[0]:.4f} → {found[-1]:.4f})", True)
