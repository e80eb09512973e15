"""Update rules and learning-rate policies, on examples worked by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from netlib.proto.messages import SolverParameter
from netlib.updates import RULES, learning_rate, steps_taken

pytestmark = pytest.mark.both_engines


def solver(**options: Any) -> SolverParameter:
    return SolverParameter(**options)


def run(rule: str, gradients: list[float], rate: float = 0.1, **options: Any) -> list[float]:
    """Return the weight, initially 1, after each update."""
    apply, count = RULES[rule]
    w, history, found = np.array([1.0]), [np.zeros(1) for _ in range(count)], []
    for t, g in enumerate(gradients, 1):
        apply(solver(**options), w, np.array([float(g)]), rate, history, t)
        found.append(float(w[0]))
    return found


@pytest.mark.parametrize(
    ("rule", "options", "expected"),
    [
        # h: 0.2, then 0.5 * 0.2 + 0.1 * 4 = 0.5
        ("SGD", {"momentum": 0.5}, [0.8, 0.3]),
        ("SGD", {}, [0.8, 0.4]),
        # h: 0.2, 0.5; steps 1.5 * 0.2 - 0 = 0.3, then 1.5 * 0.5 - 0.5 * 0.2 = 0.65
        ("Nesterov", {"momentum": 0.5}, [0.7, 0.05]),
        # h: 4, 20
        ("AdaGrad", {"delta": 0.0}, [1 - 0.2 / 2, 0.9 - 0.4 / math.sqrt(20)]),
        ("AdaGrad", {"delta": 2.0}, [1 - 0.2 / 4, 0.95 - 0.4 / (math.sqrt(20) + 2)]),
        # h: 0.25 * 4 = 1, then 0.75 + 4 = 4.75
        ("RMSProp", {"rms_decay": 0.75, "delta": 0.0}, [1 - 0.2 / 1, 0.8 - 0.4 / math.sqrt(4.75)]),
        # h: 2, 9; u = 2 sqrt(1 / 3), then q = 2/3, u = 4 sqrt((2/3 + 1) / 10)
        (
            "AdaDelta",
            {"momentum": 0.5, "delta": 1.0},
            [
                1 - 0.2 * math.sqrt(1 / 3),
                1 - 0.2 * math.sqrt(1 / 3) - 0.4 * math.sqrt((2 / 3 + 1) / 10),
            ],
        ),
        # m: 1, 2.5; v: 1, 4.75; corrections sqrt(1 - 0.75) / 0.5 = 1, sqrt(1 - 0.5625) / 0.75
        (
            "Adam",
            {"momentum": 0.5, "momentum2": 0.75, "delta": 0.0},
            [1 - 0.1, 0.9 - 0.1 * math.sqrt(0.4375) / 0.75 * 2.5 / math.sqrt(4.75)],
        ),
    ],
)
def test_two_updates_by_hand(rule: str, options: dict[str, float], expected: list[float]) -> None:
    assert run(rule, [2, 4], **options) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("policy", "options", "expected"),
    [
        ("fixed", {}, {0: 2, 1000: 2}),
        ("step", {"gamma": 0.5, "stepsize": 10}, {0: 2, 9: 2, 10: 1, 19: 1, 20: 0.5}),
        ("step", {"stepsize": 10}, {0: 2, 9: 2, 10: 0}),  # without a gamma, as in Caffe
        ("exp", {"gamma": 0.5}, {0: 2, 1: 1, 3: 0.25}),
        ("inv", {"gamma": 0.5, "power": 2}, {0: 2, 2: 0.5, 6: 0.125}),
        (
            "multistep",
            {"gamma": 0.5, "stepvalue": (2, 5)},
            {0: 2, 1: 2, 2: 1, 4: 1, 5: 0.5, 99: 0.5},
        ),
        ("multistep", {"gamma": 0.5}, {0: 2, 99: 2}),
        ("poly", {"power": 2, "max_iter": 10}, {0: 2, 5: 0.5, 10: 0}),
        ("poly", {"power": 0.5, "max_iter": 10}, {11: 0}),  # after its end
        (
            "sigmoid",
            {"gamma": -0.5, "stepsize": 4},
            {4: 1, 0: 2 / (1 + math.exp(-2)), 8: 2 / (1 + math.exp(2))},
        ),
        ("sigmoid", {"gamma": -10.0, "stepsize": 1000}, {0: 2, 2000: 0}),  # without an overflow
        # linearly from rampup_lr to base_lr, then as if the policy had run from the start
        (
            "poly",
            {"power": 1, "max_iter": 10, "rampup_interval": 4, "rampup_lr": 1.0},
            {0: 1, 1: 1.25, 2: 1.5, 3: 1.75, 4: 1.2, 5: 1},
        ),
    ],
)
def test_learning_rate_policies(
    policy: str, options: dict[str, Any], expected: dict[int, float]
) -> None:
    p = solver(base_lr=2.0, lr_policy=policy, **options)
    assert {i: learning_rate(p, i) for i in expected} == pytest.approx(expected)


def test_multistep_takes_at_most_one_step_an_iteration() -> None:
    """Equal or adjacent step values take effect one iteration after another, as in Caffe."""
    p = solver(lr_policy="multistep", stepvalue=(3, 3, 4))
    assert [steps_taken(p, i) for i in range(8)] == [0, 0, 0, 1, 2, 3, 3, 3]
    assert steps_taken(solver(lr_policy="step", stepsize=3), 7) == 2
    assert steps_taken(solver(lr_policy="fixed"), 7) == 0
