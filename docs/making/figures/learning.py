"""Figures of chapters 6 and 7."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.making.figures.drawn import new_figure
from docs.making.palette import FIRST, FOURTH, SECOND, THIRD
from netlib.blob import Array
from netlib.proto import schema
from netlib.proto.messages import SolverParameter
from netlib.updates import RULES, learning_rate

START = (10.0, 2.0)
STEEP = np.array([1.0, 9.0])  # the curvatures of the valley ½ (x² + 9 y²)
STEPS = 30
PATHS = (  # name, colour, mark, rule, options: the best for this valley, but Adam's
    ("plain, r = 0.2", FIRST, "o", "SGD", {"base_lr": 0.2}),
    ("momentum, r = 0.25, m = 0.25", SECOND, "s", "SGD", {"base_lr": 0.25, "momentum": 0.25}),
    ("Nesterov, r = 1/9, m = 0.5", THIRD, "^", "Nesterov", {"base_lr": 1 / 9, "momentum": 0.5}),
    ("Adam, r = 1, m = 0.5", FOURTH, "D", "Adam", {"base_lr": 1.0, "momentum": 0.5}),
)
POLICIES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("fixed", {}),
    ("step: gamma 0.5, stepsize 20", {"gamma": 0.5, "stepsize": 20}),
    ("multistep: gamma 0.1, at 60 and 85", {"gamma": 0.1, "stepvalue": (60, 85)}),
    ("exp: gamma 0.95", {"gamma": 0.95}),
    ("inv: gamma 0.1, power 0.75", {"gamma": 0.1, "power": 0.75}),
    ("poly: power 2, max_iter 100", {"power": 2.0, "max_iter": 100}),
    ("sigmoid: gamma −0.2, stepsize 50", {"gamma": -0.2, "stepsize": 50}),
    ("poly: power 1, with rampup_interval 20", {"power": 1.0, "max_iter": 100, "rampup_interval": 20}),
)


def path_of(rule: str, **options: float) -> Array:
    """The places (STEPS + 1, 2) on the way down."""
    param = schema.changed(SolverParameter(), **options)
    update, count = RULES[rule]
    w, histories = np.array(START), [np.zeros(2) for _ in range(count)]
    places = [w.copy()]
    for t in range(STEPS):
        update(param, w, STEEP * w, param.base_lr, histories, t + 1)
        places.append(w.copy())
    return np.array(places)


def valley() -> Any:
    """The paths of four rules, and their losses."""
    figure = new_figure(8.5, 6.0)
    above, below = figure.subplots(2, 1, gridspec_kw={"height_ratios": (3, 2)})
    x, y = np.meshgrid(np.linspace(-2, 10.7, 60), np.linspace(-3.2, 3.2, 40))
    above.contour(x, y, 0.5 * (x**2 + 9 * y**2), levels=[1, 4, 10, 20, 35, 55, 80], colors="0.8", linewidths=0.8)
    for name, colour, mark, rule, options in PATHS:
        places = path_of(rule, **options)
        shown = places[:11]
        above.plot(shown[:, 0], shown[:, 1], color=colour, marker=mark, ms=4, lw=1.2, label=name)
        below.semilogy(0.5 * (places**2 @ STEEP), color=colour, marker=mark, ms=3, lw=1.2)
    above.plot([0], [0], "k+", ms=12)
    above.set_xlabel("x")
    above.set_ylabel("y")
    above.set_title("ten steps down the valley ½ (x² + 9 y²), from (10, 2)")
    above.legend(fontsize=8, loc="upper left")
    below.set_ylim(1e-12, 200)
    below.set_xlabel("step")
    below.set_ylabel("loss")
    below.grid(alpha=0.3)
    return figure


def rates() -> Any:
    """The learning-rate policies as functions of the iteration."""
    figure = new_figure(8.5, 4.0)
    for axes, (name, options) in zip(figure.subplots(2, 4, sharex=True, sharey=True).flat, POLICIES):
        param = schema.changed(SolverParameter(), base_lr=1.0, lr_policy=name.partition(":")[0], **options)
        axes.plot([learning_rate(param, i) for i in range(101)], color=FIRST, lw=1.5)
        axes.set_title(name.replace(": ", "\n").replace(", with", "\nwith"), fontsize=8)
        axes.set_ylim(-0.05, 1.1)
        axes.grid(alpha=0.3)
    figure.supxlabel("iteration", fontsize=9)
    figure.supylabel("rate, of base_lr", fontsize=9)
    return figure
