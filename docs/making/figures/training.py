"""Figures of chapters 1, 2, 6, 7 and 10: curves."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.making.figures.drawing import FIRST, FOURTH, SECOND, THIRD, new_figure
from netlib.blob import Array
from netlib.proto import schema
from netlib.proto.messages import SolverParameter
from netlib.updates import RULES, learning_rate


def differences() -> Any:
    """Chapter 1: the error of a difference quotient over its step, in float32 and float64."""
    figure = new_figure(7.5, 3.6)
    axes = figure.add_subplot()
    for dtype, colour in ((np.float64, FIRST), (np.float32, SECOND)):
        steps = np.logspace(-12 if dtype is np.float64 else -7, 0, 100)
        for kind, style in (("central", "-"), ("one-sided", ":")):
            errors = [error(dtype, h, kind) for h in steps]
            name = f"{kind}, {dtype.__name__}"
            axes.loglog(steps, errors, style, color=colour, label=name, lw=1.2)
    title = "the slope of x³ by differences, the worst of 31 places between ½ and 1"
    axes.set(xlabel="step h", ylabel="relative error", title=title)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def error(dtype: Any, h: float, kind: str) -> float:
    """The relative error of a difference quotient of x³, the largest of 31 places: in one place
    errors may cancel.
    """
    x = np.linspace(0.5, 1, 31).astype(dtype)
    step = dtype(h)
    above, below, width = x + step, x, step
    if kind == "central":
        below, width = x - step, step + step
    # Products are the same on every machine, powers are not.
    quotient = (above * above * above - below * below * below) / width
    slope = 3 * x.astype(float) ** 2
    return float(abs(quotient / slope - 1).max())


def initial() -> Any:
    """Chapter 2: standard deviations in ten layers of 512 with ReLU, by either rule."""
    figure = new_figure(6.5, 3.0)
    axes = figure.add_subplot()
    for factor, name, colour in ((1, "Xavier, 1/I", FIRST), (2, "He, 2/I", SECOND)):
        axes.semilogy(range(1, 11), deviations_of(factor), "o-", color=colour, label=name)
    axes.set(xlabel="layer", ylabel="standard deviation", ylim=(0.01, 2))
    axes.set_title("ten layers of 512 with ReLU between them")
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def deviations_of(factor: float) -> list[float]:
    """The standard deviation of each layer's output for weights of the variance factor / inputs."""
    rng = np.random.default_rng(0)
    deviations = []
    y = rng.normal(size=(1000, 512))
    for _ in range(10):
        w = rng.normal(0, np.sqrt(factor / 512), (512, 512))
        y = np.maximum(y, 0) @ w.T
        deviations.append(y.std())
    return deviations


START = (10.0, 2.0)
STEEP = np.array([1.0, 9.0])  # the curvatures of the valley ½ (x² + 9 y²)
STEPS = 30
# Label, colour, marker, rule and options; the options are the best for this valley, except Adam's.
PATHS: tuple[tuple[str, str, str, str, dict[str, float]], ...] = (
    ("plain, r = 0.2", FIRST, "o", "SGD", {"base_lr": 0.2}),
    ("momentum, r = 0.25, m = 0.25", SECOND, "s", "SGD", {"base_lr": 0.25, "momentum": 0.25}),
    ("Nesterov, r = 1/9, m = 0.5", THIRD, "^", "Nesterov", {"base_lr": 1 / 9, "momentum": 0.5}),
    ("Adam, r = 1, m = 0.5", FOURTH, "D", "Adam", {"base_lr": 1.0, "momentum": 0.5}),
)


def valley() -> Any:
    """Chapter 6: the paths of four rules down a valley, and their losses."""
    figure = new_figure(8.5, 6.0)
    above, below = figure.subplots(2, 1, gridspec_kw={"height_ratios": (3, 2)})
    x, y = np.meshgrid(np.linspace(-2, 10.7, 60), np.linspace(-3.2, 3.2, 40))
    loss = 0.5 * (x**2 + 9 * y**2)
    above.contour(x, y, loss, levels=[1, 4, 10, 20, 35, 55, 80], colors="0.8", linewidths=0.8)
    for name, colour, mark, rule, options in PATHS:
        path = path_of(rule, **options)
        above.plot(*path[:11].T, color=colour, marker=mark, ms=4, lw=1.2, label=name)
        below.semilogy(0.5 * (path**2 @ STEEP), color=colour, marker=mark, ms=3, lw=1.2)
    above.plot([0], [0], "k+", ms=12)
    above.set(xlabel="x", ylabel="y", title="ten steps down the valley ½ (x² + 9 y²), from (10, 2)")
    above.legend(fontsize=8, loc="upper left")
    below.set(ylim=(1e-12, 200), xlabel="step", ylabel="loss")
    below.grid(alpha=0.3)
    return figure


def path_of(rule: str, **options: float) -> Array:
    """The positions (STEPS + 1, 2) on the way down."""
    param = schema.changed(SolverParameter(), **options)
    update, count = RULES[rule]
    w = np.array(START)
    histories = [np.zeros(2) for _ in range(count)]
    path = [w.copy()]
    for t in range(STEPS):
        update(param, w, STEEP * w, param.base_lr, histories, t + 1)
        path.append(w.copy())
    return np.array(path)


POLICIES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("fixed", {}),
    ("step: gamma 0.5, stepsize 20", {"gamma": 0.5, "stepsize": 20}),
    ("multistep: gamma 0.1, at 60 and 85", {"gamma": 0.1, "stepvalue": (60, 85)}),
    ("exp: gamma 0.95", {"gamma": 0.95}),
    ("inv: gamma 0.1, power 0.75", {"gamma": 0.1, "power": 0.75}),
    ("poly: power 2, max_iter 100", {"power": 2.0, "max_iter": 100}),
    ("sigmoid: gamma −0.2, stepsize 50", {"gamma": -0.2, "stepsize": 50}),
    (
        "poly: power 1, with rampup_interval 20",
        {"power": 1.0, "max_iter": 100, "rampup_interval": 20},
    ),
)


def rates() -> Any:
    """Chapter 7: the learning-rate policies as functions of the iteration."""
    figure = new_figure(8.5, 4.0)
    grid = figure.subplots(2, 4, sharex=True, sharey=True)
    for axes, (name, options) in zip(grid.flat, POLICIES):
        policy = name.partition(":")[0]
        param = schema.changed(SolverParameter(), base_lr=1.0, lr_policy=policy, **options)
        axes.plot([learning_rate(param, i) for i in range(101)], color=FIRST, lw=1.5)
        axes.set_title(name.replace(": ", "\n").replace(", with", "\nwith"), fontsize=8)
        axes.set_ylim(-0.05, 1.1)
        axes.grid(alpha=0.3)
    figure.supxlabel("iteration", fontsize=9)
    figure.supylabel("rate, of base_lr", fontsize=9)
    return figure


def overfitting() -> Any:
    """Chapter 7's thirty rows of noise: the loss on them and on a thousand others, without
    and with decay.
    """
    figure = new_figure(8.0, 3.0)
    for axes, decay in zip(figure.subplots(1, 2, sharey=True), (0.0, 1.0)):
        seen, unseen = losses_on_noise(decay)
        axes.plot(range(1, 502), seen, color=FIRST, label="30 training rows")
        axes.plot(range(1, 502), unseen, color=SECOND, label="1,000 other rows")
        axes.set(xscale="log", xlabel="iteration", title=f"weight_decay: {decay:g}", ylim=(0, 2))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("loss")
    figure.axes[0].legend(fontsize=8)
    return figure


def losses_on_noise(decay: float) -> tuple[list[float], list[float]]:
    """The losses on 30 training rows and on 1,000 others, before each of 501 steps down."""
    rng = np.random.default_rng(0)

    def rows(count: int) -> tuple[Array, Array]:
        x = rng.normal(size=(count, 20))
        return x, x[:, 0] - x[:, 1] + rng.normal(size=count)

    x, t = rows(30)
    other_x, other_t = rows(1000)
    w = np.zeros(20)
    b = 0.0
    seen, unseen = [], []
    for _ in range(501):
        residual = x @ w + b - t
        seen.append(0.5 * (residual**2).mean())
        unseen.append(0.5 * ((other_x @ w + b - other_t) ** 2).mean())
        dw = x.T @ residual / len(x) + decay * w
        db = residual.mean() + decay * b
        w = w - 0.1 * dw
        b = b - 0.1 * db
    return seen, unseen


def hinge() -> Any:
    """Chapter 10: PhysLimit of one angle with limits −1 and 1, and its slope:
    linear and squared.
    """
    figure = new_figure(8.0, 3.2)
    x = np.linspace(-2, 2, 201)
    beyond = np.maximum(x - 1, 0) - np.maximum(-1 - x, 0)
    loss_axes, slope_axes = figure.subplots(1, 2)
    loss = (loss_axes, "the loss of one angle", np.abs(beyond), beyond**2)
    slope = (slope_axes, "its slope", np.sign(beyond), 2 * beyond)
    for axes, title, linear, squared in (loss, slope):
        axes.axvspan(-1, 1, color="0.93")
        axes.plot(x, linear, color=FIRST, label="L1: linear, the paper's Eq. 2")
        axes.plot(x, squared, color=SECOND, ls="--", label="L2: squared, as released")
        axes.set(xlabel="angle (grey: within the limits)", title=title)
        axes.grid(alpha=0.3)
    loss_axes.legend(fontsize=8)
    return figure
