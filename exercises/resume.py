"""Exercise: the exact continuation of an interrupted training."""

from __future__ import annotations

import contextlib
import functools
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from exercises import network
from exercises.exercise import Case, Check, Exercise, Mistake, Part, Values
from netlib.blob import Array
from netlib.errors import DivergenceError
from netlib.files import atomic, hdf5
from netlib.snapshots import snapshot, weights
from netlib.solver import Solver

BEFORE, AFTER = 4, 4  # iterations before the snapshot and after it
AXES = {"loss": "iteration", "averaged loss": "iteration", "iter": "", "w": "i"}
FIXED = 'base_lr: 0.1 lr_policy: "fixed"'
SAME = """
layer { name: "x" type: "DummyData" top: "x" top: "t" dummy_data_param { shape { dim: 4 dim: 2 } shape { dim: 4 dim: 2 }
        data_filler { value: 0.5 } data_filler { value: 1 } } }
"""
ROWS = 'layer { name: "x" type: "HDF5Data" top: "x" top: "t" hdf5_data_param { source: "%s" batch_size: 4 %s } }'
WEIGHTS = 'inner_product_param { num_output: 2 bias_term: false weight_filler { type: "gaussian" std: 0.5 } }'
REST = f"""
layer {{ name: "ip" type: "InnerProduct" bottom: "x" top: "y" {WEIGHTS} }}
%s
layer {{ name: "ip2" type: "InnerProduct" bottom: "y" top: "y2" {WEIGHTS} }}
layer {{ name: "loss" type: "EuclideanLoss" bottom: "y2" bottom: "t" top: "loss" }}
"""
DROPOUT = 'layer { name: "drop" type: "Dropout" bottom: "y" top: "y" }'


def interrupted(
    part: Part | None, new_solver: Callable[..., Solver], iterations: int, folder: Path
) -> Solver:
    """Train a solver with seed 1, and return one with seed 2 restored from its snapshot, or
    the first itself without a part.

    ``new_solver(seed=...)`` returns a solver for a seed of its weights and random numbers; the
    snapshot is written into the folder.
    """
    first = new_solver(seed=1)
    first.step(iterations)
    if part is None:
        return first
    names = folder / "at.caffemodel.h5", folder / "at.solverstate.h5"
    snapshot.write_pair(weights.image(first.net, names[0]), part.state_of(first, names[0]), *names)
    second = new_solver(seed=2)
    second.step(1)  # a state replaces whatever was before
    part.restore_state(second, names[1])
    return second


def _continued(solver: Solver) -> Values:
    """Return the iteration of a solver, its losses and averaged losses over AFTER more
    iterations, and its weights after them.
    """
    at, losses = solver.iter, np.full((2, AFTER), np.nan)
    with contextlib.suppress(DivergenceError):  # of an inconsistent state; later losses stay NaN
        for i in range(AFTER):
            losses[:, i] = *network.trained(solver, 1), solver.loss
    w = solver.net.params["ip"][0].data
    found = {"iter": np.array(at), "loss": losses[0], "averaged loss": losses[1]}
    return found | {"w": w.ravel().copy()}


def _case(title: str, data: str, options: str = FIXED, middle: str = "") -> Case:
    """Return the case of resuming a small net; the title names the state it needs beyond the
    previous case.
    """

    def run(part: Part | None) -> Values:
        with tempfile.TemporaryDirectory(prefix="exercise.") as name:
            folder = Path(name)
            text = data.replace("rows.txt", _rows(folder)) + REST % middle
            new_solver = functools.partial(network.solver_of, text, options)
            return _continued(interrupted(part, new_solver, BEFORE, folder))

    source = "the uninterrupted run has"
    return Case(title, run, lambda: run(None), source, AXES, 0, "restore_state")


def _rows(folder: Path) -> str:
    """Write a data file with ten rows and a list of it; returns the name of the list."""
    rng = np.random.default_rng(0)
    with hdf5.created(folder / "rows.h5") as file:
        file["x"], file["t"] = rng.normal(size=(10, 2)), rng.normal(size=(10, 2))
    atomic.replace_text(folder / "rows.txt", f"{folder / 'rows.h5'}\n")
    return str(folder / "rows.txt")


COPY = "zip(state.history, _histories(solver))"
MIXED_UP = "zip(state.history, [array for arrays in solver.history for array in arrays])"
ITERATION_LOST = Mistake(
    "The iteration is not restored: solver.iter = state.iter. The learning rate and Adam's bias correction "
    "depend on it.",
    ("solver.iter = state.iter", ""),
)
HISTORY_LOST = Mistake(
    "The history is not restored: the momentum starts from 0, which slows the training for some iterations. "
    "Copy state.history into solver.history.",
    ("target[...] = weights_of.legacy_shape(array, target.shape)", "pass"),
)
HISTORIES_MIXED_UP = Mistake(
    "The histories are assigned to the wrong parameters. state_of writes, and restore_state reads, the first "
    "histories of all parameters, then the second ones: use _histories in both.",
    (COPY, MIXED_UP),
)
LAYER_STATES_LOST = Mistake(
    "The states of the layers are not restored: the next row of the data and the random number generators. "
    "Save layer_states() and restore it with _restore_layers.",
    ("_restore_layers(solver, path, _states_of_rank(solver, state))", ""),
)
AVERAGED_LOSSES_LOST = Mistake(
    "The losses averaged for display, solver.smoothed, are not restored, so the displayed values differ from those "
    "of an uninterrupted run. Write into the deque: a list in its place grows.",
    ('solver.smoothed.extend(state.extra.get("smoothed", []))', ""),
    (
        'solver.smoothed.extend(state.extra.get("smoothed", []))',
        'solver.smoothed = state.extra["smoothed"]',
    ),
)
MISTAKES = (
    ITERATION_LOST,
    HISTORY_LOST,
    HISTORIES_MIXED_UP,
    LAYER_STATES_LOST,
    AVERAGED_LOSSES_LOST,
)


def _train(part: Part, iterations: int) -> Array:
    """Train half of the iterations, take a snapshot, and train the rest in another solver."""
    half = iterations // 2
    with network.frames() as folder:
        new_solver = functools.partial(network.solver_of, network.net_text(folder))
        first = network.trained(new_solver(), half)
        second = interrupted(part, new_solver, half, folder)
        return np.concatenate([first, network.trained(second, iterations - half)])


FALLING = 'base_lr: 0.1 lr_policy: "step" stepsize: 3 gamma: 0.5'
MOMENTUM = f"{FIXED} momentum: 0.9"
TO_DO = {
    "state_of": "Return the SolverState of the solver: its iteration, steps_taken(solver.param, "
    "solver.iter), str(learned_net), the histories in one list (_histories), and extra_state(solver, others). "
    "solver.history holds a list of histories per parameter; the file holds the first "
    "histories of all parameters, then the second ones, as in Caffe.",
    "extra_state": "Return, as plain values (snapshot.as_plain), what Caffe's format cannot store: solver "
    "(_course), smoothed (the averaged losses), layers (layer_states() of solver.net and of each test net); "
    "and ranks, the list of others, if there are any.",
    "restore_state": "Read the state (snapshot.read_state), find its weights (snapshot.weights_of(path, state)), "
    "restore all of it: the weights, solver.history (write into the arrays of _histories), solver.iter, "
    "solver.smoothed (a deque: clear() and extend() it), the states of the layers (_restore_layers, with those of "
    "_states_of_rank).\n"
    "writes, _, _ = weights_of.fitting(solver.net, weights, strict=True), then "
    "weights_of.write(writes), copies weights. (The project's function also checks the histories and logs.)",
}

ITERATION = (
    _case("the same batch each time", SAME),
    _case("a learning rate that decreases every 3 iterations", SAME, FALLING),
    _case("average_loss: 6", SAME, f"{FIXED} average_loss: 6"),
)
HISTORIES = (
    _case("momentum: 0.9", SAME, MOMENTUM),
    _case("Adam, with two histories", SAME, f'{MOMENTUM} type: "Adam" momentum2: 0.99'),
)
DATA = (
    _case("rows in file order", ROWS % ("rows.txt", "")),
    _case("rows in a new random order each epoch", ROWS % ("rows.txt", "shuffle: true")),
)
CHECKS = (
    Check("exact: the weights and the iteration", ITERATION),
    Check("exact: the histories", HISTORIES),
    Check("exact: the data", DATA),
    Check("exact: the random numbers of layers", (_case("dropout", SAME, middle=DROPOUT),)),
)

EXERCISE = Exercise(
    name="resume",
    title="An exact resume",
    chapter=7,
    file="netlib/training/resume.py",
    to_do=TO_DO,
    checks=CHECKS,
    mistakes=MISTAKES,
    train=_train,
    last="the paper's network, interrupted halfway through {} iterations: the losses equal the uninterrupted ones",
    drift=0,
)
