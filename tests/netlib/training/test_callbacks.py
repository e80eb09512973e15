"""Callbacks: when a solver calls them, what they can change, and what they see of errors."""

from __future__ import annotations

from typing import Any

import pytest

import netlib
from netlib.errors import NetlibError
from netlib.training.callbacks import Callback, Functions, Request, Rollback
from tests.netlib.conftest import ONE_WEIGHT, MakeSolver

ITERATION = ["on_iteration", "on_start", "on_gradients_ready", "on_update"]


class Recorder(Callback):
    """Notes the names of the methods that are called."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def __getattribute__(self, name: str) -> Any:
        if name.startswith("on_"):
            self.seen.append(name)
        return super().__getattribute__(name)


def test_the_order_of_an_iteration(solver_of: MakeSolver) -> None:
    """The methods are called in the order in which Caffe's solver calls its callbacks."""
    solver = solver_of(ONE_WEIGHT % "")
    solver.callbacks.append(recorder := Recorder())
    solver.step(2)
    seen = [name for name in recorder.seen if name != "on_loss"]
    assert seen == ["on_step", *ITERATION, *ITERATION]


def test_tests_come_before_the_gradients(solver_of: MakeSolver) -> None:
    """A test that is due runs between on_iteration and on_start; each of its batches is announced."""
    solver = solver_of(ONE_WEIGHT % "", "test_iter: 2 test_interval: 1")
    solver.callbacks.append(recorder := Recorder())
    solver.step(1)
    assert recorder.seen[1:5] == ["on_iteration", "on_test_batch", "on_test_batch", "on_start"]


def test_functions_are_called_at_their_times(solver_of: MakeSolver) -> None:
    """Functions calls each function without arguments; those that are not given are not called."""
    solver = solver_of(ONE_WEIGHT % "")
    seen: list[tuple[str, int]] = []
    solver.callbacks.append(
        Functions(
            on_start=lambda: seen.append(("start", solver.iter)), on_update=lambda: seen.append(("update", solver.iter))
        )
    )
    solver.step(2)
    assert seen == [("start", 0), ("update", 1), ("start", 1), ("update", 2)]


@pytest.mark.parametrize(("request_", "iterations", "snapshots"), [("stop", 2, [2]), ("snapshot", 4, [2, 3, 4])])
def test_an_action(solver_of: MakeSolver, request_: Request, iterations: int, snapshots: list[int]) -> None:
    """A callback can request a stop or a snapshot after each update, as Caffe's ActionCallback."""

    class FromTheSecond(Callback):
        def action(self, request: Request | None) -> Request | None:
            return request_ if solver.iter >= 2 else request

    solver = solver_of(ONE_WEIGHT % "", "max_iter: 4")
    solver.callbacks.append(FromTheSecond())
    written = []
    paths = solver.snapshot_paths

    def noting(iteration: int) -> Any:
        written.append(iteration)
        return paths(iteration)

    solver.snapshot_paths = noting  # type: ignore[method-assign]
    assert solver.step(4) == (request_ == "snapshot")
    assert (solver.iter, written) == (iterations, snapshots)


def test_an_error_can_be_replaced(solver_of: MakeSolver) -> None:
    """Every callback sees an error of the project before it is raised, and may return another one."""

    class Named(Callback):
        def on_start(self, solver: Any) -> None:
            raise netlib.DataError("no rows")

        def on_error(self, solver: Any, error: NetlibError) -> NetlibError:
            return netlib.DataError(f"rank 1: {error}")

    solver = solver_of(ONE_WEIGHT % "")
    solver.callbacks.append(Named())
    with pytest.raises(netlib.DataError, match=r"^rank 1: no rows$") as raised:
        solver.step(1)
    assert str(raised.value.__cause__) == "no rows"


def test_one_process_is_the_root(solver_of: MakeSolver) -> None:
    """A solver without further callbacks is rank 0 of 1, and has Rollback."""
    solver = solver_of(ONE_WEIGHT % "")
    assert (solver.rank, solver.rank_count) == (0, 1)
    assert [type(callback) for callback in solver.callbacks] == [Rollback]


def test_a_seed_that_a_callback_chooses(solver_of: MakeSolver) -> None:
    """A callback given to get_solver can replace the seed, before the nets are made."""

    class Fixed(Callback):
        def seed(self, chosen: int) -> int:
            return 77

    solver_of(ONE_WEIGHT % "")  # writes the files
    solver = netlib.get_solver("solver.prototxt", seed=5, callbacks=[Fixed()])
    assert solver.seed == 77
