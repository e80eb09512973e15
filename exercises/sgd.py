"""Exercise: one SGD update of one parameter."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from exercises import network, recorded
from exercises.exercise import Case, Check, Exercise, Part, Progress, Values, known
from netlib.blob import Array
from netlib.proto.messages import SolverParameter
from netlib.updates import RULES, Rule

REFERENCE = RULES["SGD"][0]
UPDATES = 8  # recorded from each of Caffe's trainings
WEIGHTS = {"b of conv": ("conv", 1), "w of ip2": ("ip2", 0), "b of ip2": ("ip2", 1)}
AXES = dict.fromkeys(("w", "h", "g (after the update)"), ("update", "i")) | {
    "b of conv": ("update", "o"),
    "w of ip2": ("update", "o", "i"),
    "b of ip2": ("update", "o"),
}
NET = """
layer { name: "in" type: "Input" top: "data" top: "label"
        input_param { shape { dim: 8 dim: 2 dim: 13 dim: 13 } shape { dim: 8 dim: 5 } } }
layer { name: "conv" type: "Convolution" bottom: "data" top: "conv" convolution_param { num_output: 6 kernel_size: 3 } }
layer { name: "relu1" type: "ReLU" bottom: "conv" top: "conv" }
layer { name: "pool" type: "Pooling" bottom: "conv" top: "pool" pooling_param { kernel_size: 2 stride: 2 } }
layer { name: "ip1" type: "InnerProduct" bottom: "pool" top: "ip1" inner_product_param { num_output: 16 } }
layer { name: "relu2" type: "ReLU" bottom: "ip1" top: "ip1" }
layer { name: "ip2" type: "InnerProduct" bottom: "ip1" top: "ip2" inner_product_param { num_output: 5 } }
layer { name: "loss" type: "EuclideanLoss" bottom: "ip2" bottom: "label" top: "loss" }
"""
TRAININGS = {  # run with Caffe by tests/caffe/solvers
    "sgd_mom09": 'base_lr: 0.02 momentum: 0.9 lr_policy: "fixed"',
    "snap_sgd_hdf5": 'base_lr: 0.02 momentum: 0.9 lr_policy: "step" gamma: 0.5 stepsize: 6 weight_decay: 0.01',
}


@contextlib.contextmanager
def in_use(rule: Rule) -> Iterator[None]:
    """Make solvers of type SGD use this rule."""
    before = RULES["SGD"]
    RULES["SGD"] = (rule, 1)
    try:
        yield
    finally:
        RULES["SGD"] = before


def followed(rule: Rule, momentum: float, rates: Sequence[float], decay: float = 0.0) -> Values:
    """Return w, h and g after each of a few updates."""
    rng = np.random.default_rng(0)
    p = SolverParameter(base_lr=0.5, momentum=momentum, weight_decay=decay)
    w, h, found = rng.normal(size=3), np.zeros(3), []
    for t, rate in enumerate(rates):
        g = rng.normal(size=3)
        rule(p, w, g, rate, [h], t + 1)
        found.append((w.copy(), h.copy(), g))
    return dict(zip(("w", "h", "g (after the update)"), map(np.array, zip(*found))))


def caffes_training(rule: Rule, name: str) -> Values:
    """Return some weights of a small net after each update, trained like Caffe's: same initial weights, same rows."""
    arrays = recorded.everything()
    solver = network.solver_of(NET, TRAININGS[name])
    for layer, blobs in solver.net.params.items():
        for i, param in enumerate(blobs):
            param.data[...] = arrays[f"training/init/{layer}/{i}"]
    found: dict[str, list[Array]] = {title: [] for title in WEIGHTS}
    with in_use(rule):
        solver.update.rule = rule
        for t in range(UPDATES):
            for blob in ("data", "label"):
                rows = np.roll(arrays[f"training/{blob}"], -8 * t, axis=0)
                solver.net.blobs[blob].data[...] = rows[:8]
            solver.step(1)
            for title, (layer, i) in WEIGHTS.items():
                found[title].append(solver.net.params[layer][i].data.copy())
    return {title: np.array(steps) for title, steps in found.items()}


def _by_hand(title: str, momentum: float, *rates: float, decay: float = 0.0) -> Case:
    def run(part: Part) -> Values:
        return followed(part, momentum, rates, decay)

    return Case(title, run, lambda: run(REFERENCE), "the reference rule has", AXES, 1e-12, "_sgd")


def _by_caffe(name: str) -> Case:
    wanted = {t: recorded.everything()[f"training/{name}/{layer}/{i}"] for t, (layer, i) in WEIGHTS.items()}
    return Case(TRAININGS[name], lambda part: caffes_training(part, name), lambda: wanted, "Caffe has", AXES, 1e-5,
                "_sgd")


# ---------------------------------------------------------------------------------------------- mistakes


def _rate_later(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The rate is applied when w is changed, as in PyTorch. In Caffe it is part of the history, h <- m h + r g: when
    the rate decreases, earlier gradients keep the rate they were added with.
    """
    [h] = history
    h[...] = p.momentum * h + g
    w -= rate * h


def _nesterov(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """This is Nesterov's rule. SGD subtracts h itself: w <- w - h."""
    [h] = history
    before = h.copy()
    h[...] = p.momentum * h + rate * g
    w -= (1 + p.momentum) * h - p.momentum * before


def _uphill(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The update ascends. The gradient points towards a larger loss, so subtract h."""
    [h] = history
    h[...] = p.momentum * h + rate * g
    w += h


def _forgets_history(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The new h is lost: h = ... creates a new array; the next update uses the old one. Write into it: h[...] = ..."""
    [h] = history
    h = p.momentum * h + rate * g
    w -= h


def _new_weights(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The new w is lost: w = ... creates a new array, and the net keeps the old one. Write into it: w -= h."""
    [h] = history
    h[...] = p.momentum * h + rate * g
    w = w - h


def _dampens(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The gradient is multiplied by 1 - m, as in Adam's running mean. SGD uses h <- m h + r g."""
    [h] = history
    h[...] = p.momentum * h + (1 - p.momentum) * rate * g
    w -= h


def _base_rate(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The rate is taken from p.base_lr. Use the argument rate, which includes the policy and lr_mult."""
    [h] = history
    h[...] = p.momentum * h + p.base_lr * g
    w -= h


def _no_momentum(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The momentum is missing: h <- m h + r g, with m = p.momentum."""
    [h] = history
    h[...] = rate * g
    w -= h


def _changes_g(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """g is modified. The rule must not change it: debugging output and clipping use it; compute rate * g in the
    expression.
    """
    [h] = history
    g *= rate
    h[...] = p.momentum * h + g
    w -= h


def _decays_again(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The weight decay is added twice. The solver adds it to g before calling the rule."""
    [h] = history
    h[...] = p.momentum * h + rate * (g + p.weight_decay * w)
    w -= h


def _twice(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """The rate is applied twice. h already includes it, h <- m h + r g, so w changes by h itself: w <- w - h."""
    [h] = history
    h[...] = p.momentum * h + rate * g
    w -= rate * h


def _corrected(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """h is divided by 1 - m^t. That is Adam's bias correction; SGD subtracts h unchanged."""
    [h] = history
    h[...] = p.momentum * h + rate * g
    w -= h / (1 - p.momentum**t)


def _keeps_weights(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """h holds the old weights. It must hold the last update: h <- m h + r g, initially 0."""
    [h] = history
    old = w.copy()
    w += p.momentum * (w - h) * (t > 1) - rate * g
    h[...] = old


def _negative(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """h has the opposite sign, although w is correct. Use h <- m h + r g and w <- w - h: snapshots contain h."""
    [h] = history
    h[...] = p.momentum * h - rate * g
    w += h


def _late(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    """w is updated with the old h. Compute the new h first."""
    [h] = history
    w -= h
    h[...] = p.momentum * h + rate * g


def _train(part: Part, iterations: int, progress: Progress) -> Array:
    with in_use(part):
        return network.losses(iterations, progress)


def _part_of(module: object) -> Callable[..., None]:
    return getattr(module, "_sgd")  # noqa: B009  the type is object, for mypy


EXERCISE = Exercise(
    name="sgd",
    title="SGD: one update with momentum",
    chapter=6,
    file="netlib/updates.py",
    to_do={
        "_sgd": "Change h, the only array of history, and then w: h <- m h + r g, w <- w - h. m is "
        "p.momentum, r is rate. Write into both arrays (h[...] = ..., w -= ...), and leave g "
        "unchanged.",
    },
    keep=("Rule", "_sgd"),
    names=("_sgd",),
    part_of=_part_of,
    reference=REFERENCE,
    checks=(
        Check("values: a few updates of three weights", (
            _by_hand("momentum 0, one rate", 0, 0.1, 0.1, 0.1),
            _by_hand("momentum 0.9, one rate", 0.9, 0.1, 0.1, 0.1, 0.1),
            _by_hand("momentum 0.9, a decreasing rate", 0.9, 0.1, 0.1, 0.01, 0.01),
            _by_hand("momentum 0.9, weight_decay 0.1, already added to g", 0.9, 0.1, 0.1, decay=0.1),
        )),
        Check("values: a small net, trained with Caffe", tuple(map(_by_caffe, TRAININGS))),
    ),
    mistakes=known(
        _rate_later,
        _nesterov,
        _uphill,
        _forgets_history,
        _new_weights,
        _dampens,
        _base_rate,
        _no_momentum,
        _changes_g,
        _decays_again,
        _late,
        _twice,
        _corrected,
        _keeps_weights,
        _negative,
    ),
    train=_train,
)
