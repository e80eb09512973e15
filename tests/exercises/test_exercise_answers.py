"""Every stub fails, every solution passes, and every known mistake gets its own advice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from exercises import network
from exercises.checking import Step, in_network, steps
from exercises.exercise import Exercise, Mistake
from exercises.reading import ReadersFile
from exercises.runner import LocalRunner
from exercises.stubs import stub
from exercises.table import EXERCISES
from layers import LAYER_TYPES
from netlib.blob import Blobs
from netlib.updates import RULES
from tests.tools.conftest import ROOT

ITERATIONS = 2  # of the network; one exercise makes all 20
exercises = pytest.mark.parametrize("exercise", EXERCISES.values(), ids=list(EXERCISES))
MISTAKES = [
    pytest.param(exercise, mistake, id=f"{exercise.name}-{number}")
    for exercise in EXERCISES.values()
    for number, mistake in enumerate(exercise.mistakes)
]


def last_step(exercise: Exercise, part: Any, iterations: int = 0, reader: ReadersFile | None = None) -> Step:
    """Return the step that fails, or the last one."""
    return all_steps(exercise, part, iterations, reader)[-1]


def all_steps(exercise: Exercise, part: Any, iterations: int, reader: ReadersFile | None = None) -> list[Step]:
    """Return the steps up to the one that fails; with iterations=0 the network's step is left out."""
    runner = LocalRunner(exercise, part, reader)
    made = list(steps(exercise, runner))
    if made[-1].passed and iterations:
        made.append(in_network(exercise, runner, iterations))
    return made


def test_the_dozen_is_there() -> None:
    """All exercises of the book exist, in its order, each with at least eight known mistakes."""
    assert set(EXERCISES) == {
        "relu", "inner_product", "convolution", "pooling", "split", "euclidean_loss", "sgd", "resume",
        "joint_transform", "torque_gradient", "phys_limit", "dropout",
    }
    chapters = [exercise.chapter for exercise in EXERCISES.values()]
    assert chapters == sorted(chapters)
    assert set(chapters) == set(range(1, 11))
    assert min(len(exercise.mistakes) for exercise in EXERCISES.values()) >= 8


@exercises
def test_the_advice_is_short_and_never_the_same(exercise: Exercise) -> None:
    """The advice for each mistake is a few plain sentences, and no two mistakes share one."""
    said = [mistake.advice for mistake in exercise.mistakes]
    assert len(set(said)) == len(said)
    assert all(20 < len(advice) < 260 and advice.endswith(".") for advice in said)


@exercises
def test_a_stub_fails_and_says_what_to_write_first(exercise: Exercise, tmp_path: Path) -> None:
    """The report of a stub names the file, the function to write first and its line."""
    (tmp_path / f"{exercise.name}.py").write_text(stub(exercise), encoding="utf-8")
    reader = ReadersFile(exercise, tmp_path / f"{exercise.name}.py")
    assert set(reader.outline.to_do) == set(exercise.to_do)
    step = last_step(exercise, reader.part, ITERATIONS, reader)
    assert not step.passed
    name, _, rest = step.lines[0].partition(" is not written yet: ")
    assert rest == f"{reader.path}:{reader.outline.to_do[name]} (raise NotImplementedError)"


@exercises
def test_our_own_source_passes(exercise: Exercise) -> None:
    """The project's source passes all steps, loaded like a reader's file; this includes the paper's network."""
    reader = ReadersFile(exercise, ROOT / exercise.file)
    assert not reader.outline.to_do
    assert reader.part is not exercise.reference
    before = dict(LAYER_TYPES), dict(RULES)
    made = all_steps(exercise, reader.part, 20 if exercise.name == "relu" else ITERATIONS, reader)
    assert [step for step in made if not step.passed] == []
    assert len(made) == len(exercise.checks) + 1
    assert before == (LAYER_TYPES, RULES)  # the project's own classes are in place again


@pytest.mark.parametrize(("exercise", "mistake"), MISTAKES)
def test_a_mistake_gets_its_own_advice(exercise: Exercise, mistake: Mistake) -> None:
    """Each known mistake gets its own advice and that of no other mistake."""
    step = last_step(exercise, mistake.part)
    assert not step.passed
    given = [other.advice for other in exercise.mistakes if any(line.endswith(other.advice) for line in step.lines)]
    assert given == [mistake.advice]


# ---------------------------------------------------------------------------------------------- mistakes of any layer


def adding(cls: Any) -> Any:
    """Return a layer that adds to the diffs of its bottoms."""

    class Adding(cls):
        def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
            before = [blob.diff.copy() for blob in bottom]
            super().backward(top, propagate_down, bottom)
            for blob, diff in zip(bottom, before):
                blob.diff[...] += diff

    return Adding


def leaving(cls: Any) -> Any:
    """Return a layer that leaves the zeros of its gradient unwritten."""

    class Leaving(cls):
        def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
            before = [blob.diff.copy() for blob in bottom]
            super().backward(top, propagate_down, bottom)
            for blob, diff in zip(bottom, before):
                blob.diff[blob.diff == 0] = diff[blob.diff == 0]

    return Leaving


def overwriting(cls: Any) -> Any:
    """Return a layer that overwrites the diffs of its parameters."""

    class Overwriting(cls):
        def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
            for blob in self.blobs:
                blob.diff[...] = 0
            super().backward(top, propagate_down, bottom)

    return Overwriting


@pytest.mark.parametrize("name", ["relu", "inner_product", "convolution", "pooling", "split", "euclidean_loss"])
def test_a_gradient_that_is_added(name: str) -> None:
    """Adding to the diff of a bottom, which holds old numbers, is found."""
    exercise = EXERCISES[name]
    assert last_step(exercise, adding(exercise.reference)).lines[1].startswith("backward adds to the diff of a bottom.")


@pytest.mark.parametrize("name", ["relu", "pooling", "phys_limit", "dropout"])
def test_a_gradient_that_is_left(name: str) -> None:
    """A gradient left unwritten where it is 0 is found."""
    exercise = EXERCISES[name]
    assert last_step(exercise, leaving(exercise.reference)).lines[1].startswith("backward leaves some elements")


@pytest.mark.parametrize("name", ["inner_product", "convolution"])
def test_a_gradient_that_is_overwritten(name: str) -> None:
    """Overwriting a parameter's gradient, which the solver sums over several batches, is found."""
    exercise = EXERCISES[name]
    step = last_step(exercise, overwriting(exercise.reference))
    assert step.lines[0].startswith("dw[")
    assert step.lines[1].startswith("backward overwrites the diff of a parameter.")


# ---------------------------------------------------------------------------------------------- the paper's network


class ForgetsLater(LAYER_TYPES["ReLU"]):  # type: ignore[misc]
    """Passes all small examples: it goes wrong from the second batch on."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        self.calls = getattr(self, "calls", 0) + 1
        if self.calls > 1 and top[0].count > 1000:
            top[0].data[...] = 0


def test_the_network_finds_what_small_examples_do_not() -> None:
    """A mistake that the small examples miss is reported with the iteration and both losses."""
    made = all_steps(EXERCISES["relu"], ForgetsLater, ITERATIONS)
    assert [step.passed for step in made] == [True, True, True, False]
    assert made[-1].lines[0].startswith("The loss of iteration 1 is ")


class FailsInNet(LAYER_TYPES["ReLU"]):  # type: ignore[misc]
    """Fails where a blob has four axes."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        super().forward(bottom, top)
        if len(top[0].shape) == 4:
            raise ValueError("three axes only")


def test_an_error_in_the_network_is_told() -> None:
    """An error in the network is reported with the layer, and the project's own class is in place afterwards."""
    step = last_step(EXERCISES["relu"], FailsInNet, ITERATIONS)
    assert not step.passed
    assert "layer 'ReLUconvL1': forward failed: ValueError: three axes only" in step.lines[0]
    assert LAYER_TYPES["ReLU"] is EXERCISES["relu"].reference


def test_the_network_learns() -> None:
    """The network learns its few frames by heart, so the reader sees the loss fall."""
    losses = np.array(network.reference_losses(20))
    assert losses[-5:].mean() < 0.6 * losses[:5].mean()


def test_nothing_is_left_in_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames and snapshots are written to a temporary folder, which is removed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    exercise = EXERCISES["resume"]
    assert last_step(exercise, exercise.reference, 2).passed
    assert list(tmp_path.iterdir()) == []
