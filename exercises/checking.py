"""Run the steps of an exercise, stopping at the first that fails, with an explanation."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from exercises import network
from exercises.exercise import Case, Check, Exercise, Progress, agree, first_difference
from exercises.explaining import advice, sentences, tried
from exercises.reading import Failure, Outline
from exercises.runner import PartError, Runner, results

ADVICE = (
    "The part passed the earlier steps on small examples but fails in the network: a size, an option or a second batch "
    "that the examples do not cover. Look for values that your code keeps from one call to the next."
)
# NumPy's messages about shapes that do not fit.
SHAPES = re.compile(r"could not be broadcast|could not broadcast|mismatch in its core dimension|shapes .* not aligned")


@dataclass(frozen=True)
class Step:
    """The result of a step: its title, whether it passed, and the lines of explanation."""

    title: str
    passed: bool
    lines: tuple[str, ...] = ()


def first_step(exercise: Exercise, outline: Outline) -> Step:
    """List what the reader's file defines. Unwritten functions fail the step that needs them, not this one."""
    to_do = [f"{name} (line {line})" for name, line in outline.to_do.items() if name in outline.needed]
    lines = (f"not yet written: {', '.join(to_do)}",) if to_do else ()
    return Step(f"the file has {', '.join(exercise.names)}", True, lines)


def steps(exercise: Exercise, runner: Runner) -> Iterator[Step]:
    """Run the steps before the last, up to the first failure."""
    for check in exercise.checks:
        step = _checked(exercise, check, runner)
        yield step
        if not step.passed:
            return


def _checked(exercise: Exercise, check: Check, runner: Runner) -> Step:
    """Run the cases of a step."""
    for case in check.cases:
        try:
            found = first_difference(case, results(runner, case))
        except PartError as error:
            lines = [*_explain_error(case, error.failure, runner.outline)]
            if not error.failure.is_unwritten:
                lines += _known_mistake(exercise, check, runner)
            return Step(check.title, False, tuple(lines))
        if found is not None:
            lines = list(sentences(exercise, runner, found))
            return Step(check.title, False, (*lines, *_place(case, runner.outline)))
    return Step(check.title, True)


def _explain_error(case: Case, failure: Failure, outline: Outline | None) -> Iterator[str]:
    """Yield lines that explain an exception in the reader's code."""
    where = failure.where
    if failure.is_unwritten:
        yield f"{failure.function or case.method} is not written yet" + (f": {where}" if where else ".")
        return
    yield f"{where or 'error'}: {failure.text}"
    if failure.assigns:
        yield "data and diff are arrays that other layers share: write into them, with [...] = on the left."
    if SHAPES.search(failure.text):
        yield (
            "The shapes do not fit. Write the axes of each array next to it: a factor may need a transpose, "
            "swapaxes(1, 2) if the first axis is the group or the image, or another axis in a sum."
        )
    if outline and not where:
        yield f"It was raised outside {outline.path}: check what your code returns and how it changes its arguments."
    if case.title:
        yield f"The input was: {case.title}."


def _known_mistake(exercise: Exercise, check: Check, runner: Runner) -> Iterator[str]:
    """Yield advice for a known mistake that another case of the step reveals as a wrong value."""
    for case in check.cases:
        found = tried(lambda case=case: first_difference(case, results(runner, case)))  # type: ignore[misc]
        if found and (text := advice(exercise, runner, found)):
            yield f"With {case.title}: {text}"
            return


def _place(case: Case, outline: Outline | None) -> Sequence[str]:
    lines = outline.lines if outline else {}
    name = next((name for name in lines if name.split(".")[-1] == case.method), None)
    return [f"See {name}, {outline.path}:{lines[name]}."] if outline and name else []


def in_network(exercise: Exercise, runner: Runner, iterations: int, progress: Progress = lambda count: None) -> Step:
    """Run the last step: train the paper's network with the part and compare the losses with the reference."""
    title = exercise.last.format(iterations)
    expected = np.array(network.reference_losses(iterations))
    try:
        found = runner.train(iterations, progress)
    except PartError as error:
        return Step(title, False, (f"{error.failure.where or 'error'}: {error.failure.text}",))
    wrong = np.flatnonzero(~agree(found, expected, exercise.drift))
    if len(wrong):
        i = int(wrong[0])
        return Step(title, False, (
            f"The loss of iteration {i} is {found[i]:.6g}, expected {expected[i]:.6g}.",
            ADVICE,
        ))
    return Step(f"{title} ({found[0]:.4f} → {found[-1]:.4f})", True)
