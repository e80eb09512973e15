"""Exercise: one SGD update of one parameter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from exercises import network, recorded
from exercises.exercise import Case, Check, Exercise, Mistake, Part, Values, replaced
from netlib import updates
from netlib.blob import Array
from netlib.proto.messages import SolverParameter

BATCH = 8  # rows of NET
UPDATES = 8  # recorded from each of Caffe's trainings
WEIGHTS = {"b of conv": ("conv", 1), "w of ip2": ("ip2", 0), "b of ip2": ("ip2", 1)}
AXES = {
    "w": "update i",
    "h": "update i",
    "g (after the update)": "update i",
    "b of conv": "update o",
    "w of ip2": "update o i",
    "b of ip2": "update o",
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


def few_updates(part: Part, momentum: float, rates: Sequence[float], decay: float = 0.0) -> Values:
    """Return w, h and g (T, 3) after each of the T updates, one for each rate."""
    rng = np.random.default_rng(0)
    p = SolverParameter(base_lr=0.5, momentum=momentum, weight_decay=decay)
    w = rng.normal(size=3)
    h = np.zeros(3)
    updated = []
    for t, rate in enumerate(rates):
        g = rng.normal(size=3)
        part._sgd(p, w, g, rate, [h], t + 1)
        updated.append((w.copy(), h.copy(), g))
    ws, hs, gs = map(np.array, zip(*updated))
    return {"w": ws, "h": hs, "g (after the update)": gs}


def caffes_training(part: Part, name: str) -> Values:
    """Return some weights of a small net after each update, trained like Caffe's: same initial
    weights, same rows.
    """
    arrays = recorded.everything()
    solver = network.solver_of(NET, TRAININGS[name])
    solver.update.rule = part._sgd
    for layer, blobs in solver.net.params.items():
        for i, param in enumerate(blobs):
            param.data[...] = arrays[f"training/init/{layer}/{i}"]
    weights: dict[str, list[Array]] = {title: [] for title in WEIGHTS}
    for t in range(UPDATES):
        for blob in ("data", "label"):
            rows = np.roll(arrays[f"training/{blob}"], -BATCH * t, axis=0)
            solver.net.blobs[blob].data[...] = rows[:BATCH]
        solver.step(1)
        for title, (layer, i) in WEIGHTS.items():
            weights[title].append(solver.net.params[layer][i].data.copy())
    return {title: np.array(values) for title, values in weights.items()}


def _by_rule(title: str, momentum: float, *rates: float, decay: float = 0.0) -> Case:
    """Return the case of a few updates, compared with the project's rule."""

    def run(part: Part) -> Values:
        return few_updates(part, momentum, rates, decay)

    return Case(title, run, lambda: run(updates), "the reference rule has", AXES, 1e-12, "_sgd")


def _by_caffe(name: str) -> Case:
    """Return the case of one of TRAININGS, compared with the weights that Caffe recorded."""
    arrays = recorded.everything()
    expected = {
        title: arrays[f"training/{name}/{layer}/{i}"] for title, (layer, i) in WEIGHTS.items()
    }

    def run(part: Part) -> Values:
        return caffes_training(part, name)

    return Case(TRAININGS[name], run, lambda: expected, "Caffe has", AXES, 1e-5, "_sgd")


SGD = """h *= p.momentum
h += rate * g
w -= h"""
RATE_APPLIED_LATE = Mistake(
    "The rate is applied when w is changed, as in PyTorch. In Caffe it is part of the history, h <- m h + r g:"
    " when the rate decreases, earlier gradients keep the rate they were added with.",
    (SGD, "h[...] = p.momentum * h + g\nw -= rate * h"),
)
ASCENT = Mistake(
    "The update ascends. The gradient points towards a larger loss, so subtract h.",
    ("w -= h", "w += h"),
)
NEW_H_LOST = Mistake(
    "The new h is lost: h = ... creates a new array; the next update uses the old one. Write into it: h[...] ="
    " ...",
    (SGD, "h = p.momentum * h + rate * g\nw -= h"),
)
NEW_W_LOST = Mistake(
    "The new w is lost: w = ... creates a new array, and the net keeps the old one. Write into it: w -= h.",
    ("w -= h", "w = w - h"),
)
G_CHANGED = Mistake(
    "g is modified. A rule reads g and must not change it: compute rate * g in the expression.",
    ("h *= p.momentum\nh += rate * g", "h *= p.momentum\ng *= rate\nh += g"),
)
MISTAKES = (RATE_APPLIED_LATE, ASCENT, NEW_H_LOST, NEW_W_LOST, G_CHANGED)


def _train(part: Part, iterations: int) -> Array:
    with replaced(updates.RULES, "SGD", (part._sgd, 1)):
        return network.losses(iterations)


TO_DO = {
    "_sgd": "Change h, the only array of history, and then w: h <- m h + r g, w <- w - h. m is "
    "p.momentum, r is rate. Write into both arrays (h[...] = ..., w -= ...), and leave g "
    "unchanged."
}

FEW_UPDATES = (
    _by_rule("momentum 0, one rate", 0, 0.1, 0.1, 0.1),
    _by_rule("momentum 0.5, one rate", 0.5, 0.1, 0.1, 0.1, 0.1),
    _by_rule("momentum 0.9, a decreasing rate", 0.9, 0.1, 0.1, 0.01, 0.01),
    _by_rule("momentum 0.9, weight_decay 0.1, already added to g", 0.9, 0.1, 0.1, decay=0.1),
)

CHECKS = (
    Check("values: a few updates of three weights", FEW_UPDATES),
    Check("values: a small net, trained with Caffe", tuple(map(_by_caffe, TRAININGS))),
)

EXERCISE = Exercise(
    name="sgd",
    title="SGD: one update with momentum",
    chapter=6,
    file="netlib/updates.py",
    to_do=TO_DO,
    end="def _nesterov(",
    checks=CHECKS,
    mistakes=MISTAKES,
    train=_train,
)
