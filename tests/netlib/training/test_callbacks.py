"""Functions attached to a solver: when they are called, and the warnings that every solver has."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.netlib.conftest import ONE_WEIGHT, WEIGHT_WITH, MakeModule, MakeSolver


def test_the_order_of_an_iteration(solver_of: MakeSolver) -> None:
    """The functions are called in the order in which Caffe's solver calls its callbacks; tests come
    first. The gradient is cleared at the start, complete when it is ready, and then the
    update: 0.
    """
    solver = solver_of(ONE_WEIGHT, "base_lr: 0 test_iter: 2 test_interval: 1")
    seen: list[tuple[str, int, float]] = []
    gradient = solver.net.params["ip"][0].diff

    def note(what: str) -> Callable[[], None]:
        return lambda: seen.append((what, solver.iter, gradient.item()))

    solver.on_step.append(note("step"))
    solver.add_callback(note("start"), note("ready"))
    solver.on_update.append(note("update"))
    test, note_test = solver.test_nets[0].run_forward, note("test")
    solver.test_nets[0].run_forward = lambda: note_test() or test()  # type: ignore[func-returns-value, method-assign]
    solver.step(2)
    assert seen == [
        ("step", 0, 0),
        *[("test", 0, 0)] * 2,
        ("start", 0, 0),
        ("ready", 0, 2),
        ("update", 1, 0),
        *[("test", 1, 0)] * 2,
        ("start", 1, 0),
        ("ready", 1, 2),
        ("update", 2, 0),
    ]


def test_a_function_that_removes_itself(solver_of: MakeSolver) -> None:
    solver, seen = solver_of(ONE_WEIGHT), list[str]()

    def once() -> None:
        seen.append("once")
        solver.on_start.remove(once)

    solver.on_start += [once, lambda: seen.append("always")]
    solver.step(2)
    assert seen == ["once", "always", "always"]


NO_LOSS = ONE_WEIGHT[: ONE_WEIGHT.index('layer { name: "loss"')]
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


@pytest.mark.parametrize(
    ("end", "advice"),
    [
        (
            PYTHON_LOSS % "",
            "top 'distance' of layer 'half' looks like one: add loss_weight: 1 to the layer",
        ),
        (LIKE_A_LOSS, "top 'sum' of layer 'loss' looks like one: add loss_weight: 1 to the layer"),
        ("", "top 'y' of layer 'ip' looks like one: add loss_weight: 1 to the layer"),
        (SILENCED, "its outputs: none"),
    ],
    ids=["a Python layer", "a layer named loss", "a single number", "no output"],
)
def test_a_net_without_a_loss_is_reported_once(
    solver_of: MakeSolver,
    module: MakeModule,
    caplog: pytest.LogCaptureFixture,
    end: str,
    advice: str,
) -> None:
    module("half_square", HALF_SQUARE)
    solver = solver_of(NO_LOSS + end)
    for _ in range(5):
        solver.step(1)
    warnings = [message for message in caplog.messages if "loss_weight" in message]
    assert warnings == [
        f"net '' has no loss: no output has a loss_weight, so no weight changes; {advice}"
    ]


@pytest.mark.parametrize(
    ("given", "messages"),
    [
        ("loss_weight: 1", []),
        ("loss_weight: 0", []),
        (
            "",
            [
                "top 'penalty' of layer 'penalty_loss' looks like a loss, but has no loss_weight; it is ignored"
            ],
        ),
    ],
)
def test_a_python_loss_beside_another_needs_a_weight(
    solver_of: MakeSolver,
    module: MakeModule,
    caplog: pytest.LogCaptureFixture,
    given: str,
    messages: list[str],
) -> None:
    module("half_square", HALF_SQUARE)
    second = (
        (PYTHON_LOSS % given).replace('"half"', '"penalty_loss"').replace('"distance"', '"penalty"')
    )
    solver_of(ONE_WEIGHT + second).step(5)
    assert caplog.messages == messages


DEAD = (
    NO_LOSS
    + """layer { name: "dead" type: "ReLU" bottom: "y" top: "y" }
layer { name: "loss" type: "EuclideanLoss" bottom: "y" bottom: "t" top: "loss" }"""
)


def test_gradients_that_are_all_zero_are_reported_once(
    solver_of: MakeSolver, caplog: pytest.LogCaptureFixture
) -> None:
    solver = solver_of(DEAD.replace("weight_filler { value: 1 }", "weight_filler { value: -1 }"))
    solver.step(2)
    assert not caplog.messages
    for _ in range(3):
        solver.step(1)
    assert [message[:72] for message in caplog.messages] == [
        "the gradients of all parameters were exactly 0 in the first 3 iterations"
    ]


@pytest.mark.parametrize(
    "net", [DEAD, WEIGHT_WITH % "param { lr_mult: 0 }"], ids=["a living ReLU", "frozen on purpose"]
)
def test_no_warning_of_gradients(
    solver_of: MakeSolver, caplog: pytest.LogCaptureFixture, net: str
) -> None:
    solver_of(net).step(5)
    assert not caplog.messages
