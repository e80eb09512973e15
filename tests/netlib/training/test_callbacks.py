"""Callbacks: when a solver calls them, what they can change, and what they see of errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import netlib
from netlib.errors import NetlibError
from netlib.training.callbacks import Callback, Functions, GradientWarning, Request, Rollback
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
    """A solver without further callbacks is rank 0 of 1, and the two callbacks of every solver."""
    solver = solver_of(ONE_WEIGHT % "")
    assert (solver.rank, solver.rank_count) == (0, 1)
    assert [type(callback) for callback in solver.callbacks] == [Rollback, GradientWarning]


def test_a_seed_that_a_callback_chooses(solver_of: MakeSolver) -> None:
    """A callback given to get_solver can replace the seed, before the nets are made."""

    class Fixed(Callback):
        def seed(self, chosen: int) -> int:
            return 77

    solver_of(ONE_WEIGHT % "")  # writes the files
    solver = netlib.get_solver("solver.prototxt", seed=5, callbacks=[Fixed()])
    assert solver.seed == 77


NO_LOSS = ONE_WEIGHT[: ONE_WEIGHT.index("layer { name: \"loss\"")]
PYTHON_LOSS = """layer { name: "half" type: "Python" bottom: "y" bottom: "t" top: "distance"
                         python_param { module: "half_square" layer: "HalfSquare" } %s }"""
HALF_SQUARE = """
import netlib

class HalfSquare(netlib.Layer):
    def reshape(self, bottom, top):
        top[0].reshape()

    def forward(self, bottom, top):
        top[0].data[...] = ((bottom[0].data - bottom[1].data) ** 2).sum() / 2

    def backward(self, top, propagate_down, bottom):
        bottom[0].diff[...] = top[0].diff * (bottom[0].data - bottom[1].data)
"""
LIKE_A_LOSS = 'layer { name: "loss" type: "Reduction" bottom: "y" top: "sum" }'
SILENCED = 'layer { name: "end" type: "Silence" bottom: "y" bottom: "t" }'


@pytest.mark.parametrize(("end", "advice"), [
    (PYTHON_LOSS % "", "top 'distance' of layer 'half' looks like one: add loss_weight: 1 to the layer"),
    (LIKE_A_LOSS, "top 'sum' of layer 'loss' looks like one: add loss_weight: 1 to the layer"),
    ("", "top 'y' of layer 'ip' looks like one: add loss_weight: 1 to the layer"),
    (SILENCED, "its outputs: none"),
], ids=["a Python layer", "a layer named loss", "a single number", "no output"])
def test_a_net_without_a_loss_is_reported_once(
    solver_of: MakeSolver, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, end: str, advice: str
) -> None:
    Path("half_square.py").write_text(HALF_SQUARE)
    monkeypatch.syspath_prepend(Path.cwd())
    solver = solver_of(NO_LOSS % "" + end)
    for _ in range(5):
        solver.step(1)
    warnings = [message for message in caplog.messages if "loss_weight" in message]
    assert warnings == [f"net '' has no loss: no output has a loss_weight, so no weight changes; {advice}"]


@pytest.mark.parametrize(("given", "messages"), [
    ("loss_weight: 1", []), ("loss_weight: 0", []),
    ("", ["top 'penalty' of layer 'penalty_loss' looks like a loss, but has no loss_weight; it is ignored"]),
])
def test_a_python_loss_beside_another_needs_a_weight(
    solver_of: MakeSolver, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, given: str,
    messages: list[str],
) -> None:
    Path("half_square.py").write_text(HALF_SQUARE)
    monkeypatch.syspath_prepend(Path.cwd())
    second = (PYTHON_LOSS % given).replace('"half"', '"penalty_loss"').replace('"distance"', '"penalty"')
    solver_of(ONE_WEIGHT % "" + second).step(5)
    assert caplog.messages == messages


DEAD = NO_LOSS % "" + """layer { name: "dead" type: "ReLU" bottom: "y" top: "y" }
layer { name: "loss" type: "EuclideanLoss" bottom: "y" bottom: "t" top: "loss" }"""


def test_gradients_that_are_all_zero_are_reported_once(
    solver_of: MakeSolver, caplog: pytest.LogCaptureFixture
) -> None:
    solver = solver_of(DEAD.replace("weight_filler { value: 1 }", "weight_filler { value: -1 }"))
    solver.step(2)
    assert not caplog.messages
    for _ in range(3):
        solver.step(1)
    assert [message[:72] for message in caplog.messages] == [
        "the gradients of all parameters were exactly 0 in the first 3 iterations"]


@pytest.mark.parametrize("net", [DEAD, ONE_WEIGHT % "param { lr_mult: 0 }"], ids=["a living ReLU", "frozen on purpose"])
def test_no_warning_of_gradients(solver_of: MakeSolver, caplog: pytest.LogCaptureFixture, net: str) -> None:
    solver_of(net).step(5)
    assert not caplog.messages
