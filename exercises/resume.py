"""Exercise: the exact continuation of an interrupted training."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from exercises import network
from exercises.exercise import Case, Check, Exercise, Mistake, Progress, Values, advice_of
from netlib.blob import Array
from netlib.errors import DivergenceError
from netlib.files import atomic, hdf5
from netlib.snapshots import snapshot, weights
from netlib.snapshots.solver_state import SolverState
from netlib.solver import Solver
from netlib.training import resume as source

BEFORE, AFTER = 4, 4  # iterations before the snapshot and after it
AXES = {"loss": ("iteration",), "averaged loss": (), "iter": (), "w": ("i",)}
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


@dataclass(frozen=True)
class Functions:
    """The part: the functions that save and restore a solver state."""

    state_of: Callable[[Any, Path], SolverState]
    restore_state: Callable[[Any, Path], None]


REFERENCE = Functions(source.state_of, source.restore_state)


@contextlib.contextmanager
def interrupted(part: Functions, make: Callable[[int], Solver], iterations: int) -> Iterator[Solver]:
    """Yield a new solver, with other weights and random numbers, restored from the snapshot of a trained solver."""
    with tempfile.TemporaryDirectory(prefix="exercise.") as folder:
        first = make(1)
        first.step(iterations)
        names = Path(folder) / "at.caffemodel.h5", Path(folder) / "at.solverstate.h5"
        snapshot.write_pair(weights.image(first.net, names[0]), part.state_of(first, names[0]), *names)
        second = make(2)
        part.restore_state(second, names[1])
        yield second


def _found(solver: Solver) -> Values:
    """Return the state of a solver and its losses over AFTER more iterations."""
    at = solver.iter
    course = np.full(AFTER, np.nan)
    with contextlib.suppress(DivergenceError):  # of an inconsistent state
        for i in range(AFTER):
            course[i : i + 1] = network.trained(solver, 1)
    param = solver.net.params["ip"][0].data
    return {"iter": np.array(at), "loss": course, "averaged loss": np.array(solver.loss), "w": param.ravel().copy()}


def _case(title: str, data: str, options: str = FIXED, middle: str = "") -> Case:
    """Return the case of resuming a small net; the title names the state it needs beyond the previous case."""

    @contextlib.contextmanager
    def solvers() -> Iterator[Callable[[int], Solver]]:
        with tempfile.TemporaryDirectory(prefix="exercise.") as folder:
            text = data.replace("rows.txt", _rows(Path(folder))) if "rows.txt" in data else data
            yield lambda seed: network.solver_of(text + REST % middle, options, seed=seed)

    def run(part: Functions) -> Values:
        with solvers() as make, interrupted(part, make, BEFORE) as solver:
            return _found(solver)

    def uninterrupted() -> Values:
        with solvers() as make:
            solver = make(1)
            solver.step(BEFORE)
            return _found(solver)

    return Case(title, run, uninterrupted, "the uninterrupted run has", AXES, 0, "restore_state")


def _rows(folder: Path) -> str:
    """Write a data file with ten rows and a list of it; returns the name of the list."""
    rng = np.random.default_rng(0)
    with hdf5.created(folder / "rows.h5") as file:
        file["x"], file["t"] = rng.normal(size=(10, 2)), rng.normal(size=(10, 2))
    atomic.replace_text(folder / "rows.txt", f"{folder / 'rows.h5'}\n")
    return str(folder / "rows.txt")


# ---------------------------------------------------------------------------------------------- mistakes

Back = Callable[[], None]


def _forgetting(forgets: Callable[[Solver], Back]) -> Mistake:
    """Return a mistake: a restore that leaves one part of the state unchanged."""

    def restore_state(solver: Solver, path: Path) -> None:
        back = forgets(solver)
        REFERENCE.restore_state(solver, path)
        back()

    return Mistake(replace(REFERENCE, restore_state=restore_state), advice_of(forgets))


def _weights(solver: Solver) -> Back:
    """The weights are not restored: call weights_of.write with the result of weights_of.fitting."""
    before = [param.blob.data.copy() for param in solver.net.learnable]

    def back() -> None:
        for param, data in zip(solver.net.learnable, before):
            param.blob.data[...] = data

    return back


def _iter(solver: Solver) -> Back:
    """The iteration is not restored: solver.iter = state.iter. The learning rate and Adam's bias correction depend on
    it.
    """
    return lambda: setattr(solver, "iter", 0)


def _smoothed(solver: Solver) -> Back:
    """The losses averaged for display, solver.smoothed, are not restored, so the displayed values differ from those of
    an uninterrupted run.
    """
    return solver.smoothed.clear


def _all_but_last(solver: Solver) -> Back:
    """Only the last of the averaged losses is restored. Restore all of solver.smoothed: clear, then extend."""

    def back() -> None:
        last = list(solver.smoothed)[-1:]
        solver.smoothed.clear()
        solver.smoothed.extend(last)

    return back


def _momentum(solver: Solver) -> Back:
    """The history is not restored: the momentum starts from 0, which slows the training for some iterations. Copy
    state.history into solver.history.
    """

    def back() -> None:
        for arrays in solver.history:
            for array in arrays:
                array[...] = 0

    return back


def _second_history(solver: Solver) -> Back:
    """The second history of each parameter is not restored: Adam has two, and state.history holds the first histories
    of all parameters, then the second ones.
    """

    def back() -> None:
        for arrays in solver.history:
            for array in arrays[1:]:
                array[...] = 0

    return back


def _mixed_up(solver: Solver) -> Back:
    """The histories are assigned to the wrong parameters. state_of writes, and restore_state reads, the first histories
    of all parameters, then the second ones: entry i is history i // count of parameter i % count.
    """

    def back() -> None:
        flat = [arrays[i].copy() for i in range(len(solver.history[0])) for arrays in solver.history]
        per_parameter = len(solver.history[0])
        for i, array in enumerate(flat):
            solver.history[i // per_parameter][i % per_parameter][...] = array

    return back


def _layers(solver: Solver) -> Back:
    """The states of the layers are not restored: the next row of the data and the random number generators. Save
    layer_states() and restore it with _restore_layers.
    """
    states = solver.net.layer_states()
    return lambda: solver.net.restore_layer_states(states)


def _cursor(solver: Solver) -> Back:
    """The data restart from the first row: the state of a data layer contains a cursor, the index of the next row."""
    states = {name: state for name, state in solver.net.layer_states().items() if "cursor" in state}
    return lambda: solver.net.restore_layer_states(states)


def _random_numbers(solver: Solver) -> Back:
    """The layers' random number generators restart, so dropout draws other masks: their states are part of the training
    state.
    """
    states = {name: state for name, state in solver.net.layer_states().items() if "rng" in state}
    return lambda: solver.net.restore_layer_states(states)


def _train(part: Functions, iterations: int, progress: Progress) -> Array:
    """Train half of the iterations, take a snapshot, and train the rest in another solver."""
    half = iterations // 2
    with network.frames() as folder:

        def make(seed: int) -> Solver:
            return network.solver_of(network.net_text(folder), seed=seed)

        first = network.trained(make(1), half, progress)
        with interrupted(part, make, half) as solver:
            return np.concatenate([first, network.trained(solver, iterations - half, progress)])


FALLING = 'base_lr: 0.1 lr_policy: "step" stepsize: 3 gamma: 0.5'
MOMENTUM = f"{FIXED} momentum: 0.9"
EXERCISE = Exercise(
    name="resume",
    title="An exact resume",
    chapter=7,
    file="netlib/training/resume.py",
    to_do={
        "state_of": "Return the SolverState of the solver: its iteration, steps_taken(solver.param, "
        "solver.iter), str(learned_net), the histories in one list, and extra_state(solver). "
        "solver.history holds a list of histories per parameter; the file holds the first "
        "histories of all parameters, then the second ones, as in Caffe.",
        "extra_state": "Return, as plain values (snapshot.as_plain), what Caffe's format cannot store: solver "
        "(_course), smoothed (the averaged losses), layers (layer_states() of solver.net and of each test net); "
        "and ranks, the list of others, if there are any.",
        "restore_state": "Read the state (snapshot.read_state), find its weights (snapshot.pair_of) and restore "
        "all of it: the weights, solver.history, solver.iter, solver.smoothed, the states of the "
        "layers (_restore_layers, of _states_of_rank).\n"
        "writes, _, _ = weights_of.fitting(solver.net, weights, strict=True), then "
        "weights_of.write(writes), copies weights. (The project's function also checks the histories first and "
        "logs what it does.)",
    },
    names=("state_of", "extra_state", "restore_state"),
    part_of=lambda module: Functions(module.state_of, module.restore_state),
    reference=REFERENCE,
    checks=(
        Check("exact: the weights and the iteration", (
            _case("the same batch each time", SAME),
            _case("a learning rate that decreases every 3 iterations", SAME, FALLING),
            _case("average_loss: 6", SAME, f"{FIXED} average_loss: 6"),
        )),
        Check("exact: the histories", (
            _case("momentum: 0.9", SAME, MOMENTUM),
            _case("Adam, with two histories", SAME, f'{MOMENTUM} type: "Adam" momentum2: 0.99'),
        )),
        Check("exact: the data", (
            _case("rows in file order", ROWS % ("rows.txt", "")),
            _case("rows in a new random order each epoch", ROWS % ("rows.txt", "shuffle: true")),
        )),
        Check("exact: the random numbers of layers", (_case("dropout", SAME, middle=DROPOUT),)),
    ),
    mistakes=tuple(
        _forgetting(forgets)
        for forgets in (
            _weights,
            _iter,
            _smoothed,
            _all_but_last,
            _momentum,
            _second_history,
            _mixed_up,
            _layers,
            _cursor,
            _random_numbers,
        )
    ),
    train=_train,
    last="the paper's network, interrupted halfway through {} iterations: the losses equal the uninterrupted ones",
    drift=0,
)
