"""Update rules and learning-rate policies: what turns gradients into new weights.

A rule sees one parameter at a time: its value w, gradient g (clipped, averaged, decayed), learning rate r (the
policy's times the parameter's lr_mult), its history h, and t, the number of this update counted from 1.

    SGD       h <- m h + r g                                           w <- w - h
    Nesterov  h' = m h + r g                                           w <- w - ((1 + m) h' - m h)
    AdaGrad   h <- h + g²                                              w <- w - r g / (sqrt(h) + d)
    RMSProp   h <- k h + (1 - k) g²                                    w <- w - r g / (sqrt(h) + d)
    AdaDelta  h <- m h + (1 - m) g²,  u = g sqrt((q + d) / (h + d)),
              q <- m q + (1 - m) u²                                    w <- w - r u
    Adam      h <- m h + (1 - m) g,  q <- n q + (1 - n) g²             w <- w - r c h / (sqrt(q) + d)
              c = sqrt(1 - n^t) / (1 - m^t)

m: momentum, n: momentum2, k: rms_decay, d: delta, q: the second history. In SGD the learning rate is inside the
history, as in Caffe. Sources: Caffe's sgd_solvers.hpp; Kingma and Ba 2015 (Adam); Zeiler 2012 (AdaDelta).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from netlib.schema import SolverParameter

Array = NDArray[Any]
Rule = Callable[[SolverParameter, Array, Array, float, Sequence[Array], int], None]


def _sgd(p: SolverParameter, w: Array, g: Array, rate: float, h: Sequence[Array], t: int) -> None:
    h[0][...] *= p.momentum
    g *= rate
    h[0][...] += g
    w -= h[0]


def _nesterov(p: SolverParameter, w: Array, g: Array, rate: float, h: Sequence[Array], t: int) -> None:
    old = h[0].copy()
    h[0][...] *= p.momentum
    g *= rate
    h[0][...] += g
    w -= (1 + p.momentum) * h[0] - p.momentum * old


def _adagrad(p: SolverParameter, w: Array, g: Array, rate: float, h: Sequence[Array], t: int) -> None:
    h[0][...] += g * g
    w -= rate * g / (np.sqrt(h[0]) + p.delta)


def _rmsprop(p: SolverParameter, w: Array, g: Array, rate: float, h: Sequence[Array], t: int) -> None:
    _average(h[0], g * g, p.rms_decay)
    w -= rate * g / (np.sqrt(h[0]) + p.delta)


def _adadelta(p: SolverParameter, w: Array, g: Array, rate: float, h: Sequence[Array], t: int) -> None:
    _average(h[0], g * g, p.momentum)
    update = g * np.sqrt((h[1] + p.delta) / (h[0] + p.delta))
    _average(h[1], update * update, p.momentum)
    w -= rate * update


def _adam(p: SolverParameter, w: Array, g: Array, rate: float, h: Sequence[Array], t: int) -> None:
    correction = math.sqrt(1 - p.momentum2**t) / (1 - p.momentum**t)
    step = g * (1 - p.momentum)  # one array for all that is passing: large ones are slow to get
    h[0][...] *= p.momentum
    h[0][...] += step
    np.multiply(g, g, out=step)
    step *= 1 - p.momentum2
    h[1][...] *= p.momentum2
    h[1][...] += step
    np.sqrt(h[1], out=step)
    step += p.delta
    np.divide(h[0], step, out=step)
    step *= rate * correction
    w -= step


def _average(h: Array, value: Array, keep: float) -> None:
    h *= keep
    h += (1 - keep) * value


RULES: dict[str, tuple[Rule, int]] = {  # the rule, and how many histories a parameter has
    "SGD": (_sgd, 1),
    "Nesterov": (_nesterov, 1),
    "AdaGrad": (_adagrad, 1),
    "RMSProp": (_rmsprop, 1),
    "AdaDelta": (_adadelta, 2),
    "Adam": (_adam, 2),
}


# ---------------------------------------------------------------------------------------------- learning rate
# Each policy is a pure function of the number of updates already made.


def steps_taken(p: SolverParameter, iteration: int) -> int:
    """How often the policies step and multistep have lowered the rate (Caffe's current_step)."""
    if p.lr_policy == "step":
        return iteration // p.stepsize
    if p.lr_policy != "multistep":
        return 0
    taken, due = 0, -1
    for value in p.stepvalue:  # at most one step an iteration
        due = max(value, due + 1)
        taken += due <= iteration
    return taken


POLICIES: dict[str, Callable[[SolverParameter, int], float]] = {
    "fixed": lambda p, i: p.base_lr,
    "step": lambda p, i: p.base_lr * p.gamma ** steps_taken(p, i),
    "exp": lambda p, i: p.base_lr * p.gamma**i,
    "inv": lambda p, i: p.base_lr * (1 + p.gamma * i) ** -p.power,
    "multistep": lambda p, i: p.base_lr * p.gamma ** steps_taken(p, i),
    "poly": lambda p, i: p.base_lr * (1 - min(i, p.max_iter) / p.max_iter) ** p.power,
    "sigmoid": lambda p, i: p.base_lr * float(expit(p.gamma * (i - p.stepsize))),
}


def learning_rate(p: SolverParameter, iteration: int) -> float:
    """The learning rate of the update that follows ``iteration`` updates."""
    if iteration < p.rampup_interval:
        return p.rampup_lr + (p.base_lr - p.rampup_lr) * iteration / p.rampup_interval
    return POLICIES[p.lr_policy](p, iteration)
