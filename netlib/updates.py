"""Update rules and learning-rate policies: how gradients change the weights.

A rule processes one parameter at a time: its value w, gradient g (clipped, averaged, decayed),
learning rate r (the policy's rate times lr_mult), history h, and t, the number of this update
counted from 1.

    SGD       h <- m h + r g                                  w <- w - h
    Nesterov  h' = m h + r g                                  w <- w - ((1 + m) h' - m h)
    AdaGrad   h <- h + g²                                     w <- w - r g / (sqrt(h) + d)
    RMSProp   h <- k h + (1 - k) g²                           w <- w - r g / (sqrt(h) + d)
    AdaDelta  h <- m h + (1 - m) g²,  u = g sqrt((q + d) / (h + d)),
              q <- m q + (1 - m) u²                           w <- w - r u
    Adam      h <- m h + (1 - m) g,  q <- n q + (1 - n) g²    w <- w - r c h / (sqrt(q) + d)
              c = sqrt(1 - n^t) / (1 - m^t)

m: momentum, n: momentum2, k: rms_decay, d: delta, q: the second history. As in Caffe, the history
of SGD includes the learning rate. Sources: Caffe's sgd_solvers.hpp; Kingma and Ba 2015 (Adam);
Zeiler 2012 (AdaDelta).

A rule modifies w and the histories in place; it does not change g.
"""

from __future__ import annotations

import functools
import logging
import math
from collections.abc import Callable, Sequence

import numpy as np
import scipy

from netlib.blob import Array, blocks
from netlib.building.params import Param
from netlib.errors import DivergenceError
from netlib.proto.messages import ParamSpec, SolverParameter
from netlib.system import memory

log = logging.getLogger("netlib")

# values updated at a time, so that they stay in the cache between the operations of a rule
BLOCK = 1 << 17

Rule = Callable[[SolverParameter, Array, Array, float, Sequence[Array], int], None]


def _sgd(
    p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int
) -> None:
    [h] = history
    h *= p.momentum
    h += rate * g
    w -= h


def _nesterov(
    p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int
) -> None:
    [h] = history
    before = h.copy()
    h[...] = p.momentum * h + rate * g
    w -= (1 + p.momentum) * h - p.momentum * before


def _adagrad(
    p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int
) -> None:
    [h] = history
    h += g * g
    w -= rate * g / (np.sqrt(h) + p.delta)


def _rmsprop(
    p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int
) -> None:
    [h] = history
    h[...] = p.rms_decay * h + (1 - p.rms_decay) * (g * g)
    w -= rate * g / (np.sqrt(h) + p.delta)


def _adadelta(
    p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int
) -> None:
    h, q = history
    h[...] = p.momentum * h + (1 - p.momentum) * (g * g)
    u = g * np.sqrt((q + p.delta) / (h + p.delta))
    q[...] = p.momentum * q + (1 - p.momentum) * (u * u)
    w -= rate * u


def _adam(
    p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int
) -> None:
    h, q = history
    h[...] = p.momentum * h + (1 - p.momentum) * g
    q[...] = p.momentum2 * q + (1 - p.momentum2) * (g * g)
    c = math.sqrt(1 - p.momentum2**t) / (1 - p.momentum**t)
    w -= rate * c * (h / (np.sqrt(q) + p.delta))


RULES: dict[str, tuple[Rule, int]] = {  # the rule, and its number of history arrays per parameter
    "SGD": (_sgd, 1),
    "Nesterov": (_nesterov, 1),
    "AdaGrad": (_adagrad, 1),
    "RMSProp": (_rmsprop, 1),
    "AdaDelta": (_adadelta, 2),
    "Adam": (_adam, 2),
}


class Update:
    """Updates parameters from their gradients, in Caffe's order: clip, divide by iter_size, decay,
    apply the rule.

    learnable  parameters of a net; those with lr_mult 0 are not changed
    rule       rule of the solver type, given with its number of history arrays per parameter
    history    per parameter, the arrays of the rule

    ``run`` executes jobs, given their number of values. Raises OutOfMemoryError if the training
    does not fit in memory.
    """

    def __init__(
        self,
        param: SolverParameter,
        learnable: Sequence[Param],
        run: Callable[[Sequence[Callable[[], None]], int], None],
    ) -> None:
        self.param, self.learnable, self._run = param, learnable, run
        self.rule, count = RULES[param.type]
        trained = sum(p.blob.bytes for p in learnable if p.spec.lr_mult != 0)
        memory.check(
            sum(p.blob.bytes for p in learnable) + (1 + count) * trained,
            f"for parameters, their gradients and the history of solver type {param.type}",
        )
        self.history = [
            [memory.zeros(p.blob.shape, p.blob.dtype) for _ in range(count)] for p in learnable
        ]

    def apply(self, rate: float, t: int) -> None:
        """Apply update number ``t`` (from 1) at this learning rate; modifies weights and histories.

        As in Caffe, the gradients become what was subtracted from the weights.
        """
        trained = [
            (param, h) for param, h in zip(self.learnable, self.history) if param.spec.lr_mult != 0
        ]
        scale = self._clip([param for param, _ in trained]) / self.param.iter_size
        jobs = []
        for param, history in trained:
            arrays = [a.reshape(-1) for a in (param.blob.data, param.blob.diff, *history)]
            for block in blocks(param.blob.count, BLOCK):
                jobs.append(
                    functools.partial(
                        self._change, param.spec, scale, rate, t, *(a[block] for a in arrays)
                    )
                )
        self._run(jobs, sum(param.blob.count for param, _ in trained))

    def _change(
        self,
        spec: ParamSpec,
        scale: float,
        rate: float,
        t: int,
        w: Array,
        g: Array,
        *history: Array,
    ) -> None:
        p, decay = self.param, self.param.weight_decay * spec.decay_mult
        with np.errstate(all="ignore"):  # an overflow shows in the next loss
            if scale != 1:
                g *= scale
            if decay:
                g += decay * (w if p.regularization_type == "L2" else np.sign(w))
            step = np.zeros_like(w)  # the rule subtracts from these zeros, not from w
            self.rule(p, step, g, rate * spec.lr_mult, history, t)
            w += step
            np.negative(step, out=g)

    def _clip(self, params: Sequence[Param]) -> float:
        """Factor that reduces the joint norm of all gradients to clip_gradients; 1 if
        it is smaller.
        """
        bound = self.param.clip_gradients
        if bound < 0:
            return 1.0
        norm = math.sqrt(sum(float(np.vdot(p.blob.diff, p.blob.diff)) for p in params))
        if norm <= bound:
            return 1.0
        log.info(
            "Gradient clipping: scaling down gradients (L2 norm %.6g > %.6g) by scale factor %.6g",
            norm,
            bound,
            bound / norm,
        )
        return bound / norm


# ------------------------------------------------------------------------------------ learning rate
# Each policy is a pure function of the number of updates already made.


def steps_taken(p: SolverParameter, iteration: int) -> int:
    """How many times the policies step and multistep have lowered the rate
    (Caffe's current_step).
    """
    if p.lr_policy == "step":
        return iteration // p.stepsize
    if p.lr_policy != "multistep":
        return 0
    taken, due = 0, -1
    for value in p.stepvalue:  # Caffe takes at most one step per iteration
        due = max(value, due + 1)
        taken += due <= iteration
    return taken


POLICIES: dict[str, Callable[[SolverParameter, int], float]] = {  # factors of base_lr
    "fixed": lambda p, i: 1.0,
    "step": lambda p, i: p.gamma ** steps_taken(p, i),
    "exp": lambda p, i: p.gamma**i,
    "inv": lambda p, i: (1 + p.gamma * i) ** -p.power,
    "multistep": lambda p, i: p.gamma ** steps_taken(p, i),
    "poly": lambda p, i: (1 - min(i, p.max_iter) / p.max_iter) ** p.power,
    "sigmoid": lambda p, i: float(scipy.special.expit(p.gamma * (i - p.stepsize))),
}


def learning_rate(p: SolverParameter, iteration: int) -> float:
    """Learning rate of the update that follows ``iteration`` updates. Raises DivergenceError."""
    if iteration < p.rampup_interval:
        return p.rampup_lr + (p.base_lr - p.rampup_lr) * iteration / p.rampup_interval
    try:
        return p.base_lr * POLICIES[p.lr_policy](p, iteration)
    except OverflowError:
        raise DivergenceError(
            f"iteration {iteration}: learning rate overflow with lr_policy {p.lr_policy!r}, gamma "
            f"{p.gamma:g} and power {p.power:g}; expected a gamma below 1, or fewer iterations"
        ) from None
