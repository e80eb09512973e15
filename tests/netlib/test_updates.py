"""Update rules and learning-rate policies, on examples worked by hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from netlib.proto import prototxt, schema
from netlib.proto.messages import SolverParameter
from netlib.updates import RULES, learning_rate, steps_taken
from tests.support.tables import lines_of

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
def test_two_updates_give_the_weights_worked_by_hand(
    rule: str, options: dict[str, float], expected: list[float]
) -> None:
    assert run(rule, [2, 4], **options) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("options", "rates"), lines_of(Path(__file__).with_name("learning_rates.txt"))
)
def test_learning_rates_follow_their_policy(options: str, rates: str) -> None:
    p = schema.read(prototxt.parse(f"base_lr: 2 {options}"), SolverParameter)
    expected = {int(t): float(rate) for t, rate in (pair.split(":") for pair in rates.split())}
    assert {t: learning_rate(p, t) for t in expected} == pytest.approx(expected)


def test_multistep_takes_at_most_one_step_an_iteration() -> None:
    """Equal or adjacent step values take effect one iteration after another, as in Caffe."""
    p = solver(lr_policy="multistep", stepvalue=(3, 3, 4))
    assert [steps_taken(p, i) for i in range(8)] == [0, 0, 0, 1, 2, 3, 3, 3]
    assert steps_taken(solver(lr_policy="step", stepsize=3), 7) == 2
    assert steps_taken(solver(lr_policy="fixed"), 7) == 0
