"""The exercise resume: a training that was interrupted goes on exactly."""

from __future__ import annotations

import contextlib
import functools
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from exercises import network
from exercises.exercise import Case, Check, Exercise, Mistake, Tell, Values, advice_of
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
    """The part: what makes a state, and what takes it back."""

    state_of: Callable[[Any, Path], SolverState]
    restore_state: Callable[[Any, Path], None]


OURS = Functions(source.state_of, source.restore_state)


@contextlib.contextmanager
def interrupted(part: Functions, make: Callable[[int], Solver], iterations: int) -> Iterator[Solver]:
    """A new solver, after another has trained and left a snapshot: it begins with other weights and random numbers."""
    with tempfile.TemporaryDirectory(prefix="exercise.") as folder:
        first = make(1)
        first.step(iterations)
        names = Path(folder) / "at.caffemodel.h5", Path(folder) / "at.solverstate.h5"
        snapshot.write_pair(weights.image(first.net, names[0]), part.state_of(first, names[0]), *names)
        second = make(2)
        part.restore_state(second, names[1])
        yield second


def _found(solver: Solver) -> Values:
    """What a solver says now and in some more iterations."""
    at = solver.iter
    course = np.full(AFTER, np.nan)
    with contextlib.suppress(DivergenceError):  # of a state that is mixed up
        for i in range(AFTER):
            course[i : i + 1] = network.trained(solver, 1)
    param = solver.net.params["ip"][0].data
    return {"iter": np.array(at), "loss": course, "averaged loss": np.array(solver.loss), "w": param.ravel().copy()}


def _case(title: str, data: str, options: str = FIXED, middle: str = "") -> Case:
    """A small net that a resume must go on with; the title says what it takes besides the case before."""

    @contextlib.contextmanager
    def solvers() -> Iterator[Callable[[int], Solver]]:
        with tempfile.TemporaryDirectory(prefix="exercise.") as folder:
            text = data.replace("rows.txt", _rows(Path(folder))) if "rows.txt" in data else data
            yield lambda seed: network.solver_of(text + REST % middle, options, seed=seed)

    def run(part: Functions) -> Values:
        with solvers() as make, interrupted(part, make, BEFORE) as solver:
            return _found(solver)

    @functools.cache
    def without_a_stop() -> Values:
        with solvers() as make:
            solver = make(1)
            solver.step(BEFORE)
            return _found(solver)

    return Case(title, run, lambda part: without_a_stop(), "without a stop it is", AXES, 0, "restore_state")


def _rows(folder: Path) -> str:
    """A list of one file with ten rows."""
    rng = np.random.default_rng(0)
    with hdf5.written(folder / "rows.h5") as file:
        file["x"], file["t"] = rng.normal(size=(10, 2)), rng.normal(size=(10, 2))
    atomic.replace_text(folder / "rows.txt", f"{folder / 'rows.h5'}\n")
    return str(folder / "rows.txt")


# ---------------------------------------------------------------------------------------------- mistakes

Back = Callable[[], None]


def _forgetting(forgets: Callable[[Solver], Back]) -> Mistake:
    """A restore after which something is as it was before it."""

    def restore_state(solver: Solver, path: Path) -> None:
        back = forgets(solver)
        OURS.restore_state(solver, path)
        back()

    return Mistake(replace(OURS, restore_state=restore_state), advice_of(forgets))


def _weights(solver: Solver) -> Back:
    """The weights are not those of the snapshot: weights_of.write has to be called on what weights_of.fitting
    returns.
    """
    before = [param.blob.data.copy() for param in solver.net.learnable]

    def back() -> None:
        for param, data in zip(solver.net.learnable, before):
            param.blob.data[...] = data

    return back


def _iter(solver: Solver) -> Back:
    """The iteration is not restored: solver.iter = state.iter. The learning rate depends on it, and Adam's
    correction.
    """
    return lambda: setattr(solver, "iter", 0)


def _smoothed(solver: Solver) -> Back:
    """The losses that are averaged are forgotten: solver.smoothed. What is displayed after a resume would not
    be what was displayed without one.
    """
    return solver.smoothed.clear


def _all_but_last(solver: Solver) -> Back:
    """Of the losses that are averaged only the last is there. solver.smoothed takes all of them back: clear,
    then extend.
    """

    def back() -> None:
        last = list(solver.smoothed)[-1:]
        solver.smoothed.clear()
        solver.smoothed.extend(last)

    return back


def _momentum(solver: Solver) -> Back:
    """The history is forgotten: the momentum starts from 0 again, and the training loses its speed for some iterations.
    Copy state.history into solver.history.
    """

    def back() -> None:
        for arrays in solver.history:
            for array in arrays:
                array[...] = 0

    return back


def _second_history(solver: Solver) -> Back:
    """The second history of each parameter is forgotten: Adam has two, and state.history has the first ones of all
    parameters, then the second ones.
    """

    def back() -> None:
        for arrays in solver.history:
            for array in arrays[1:]:
                array[...] = 0

    return back


def _mixed_up(solver: Solver) -> Back:
    """The histories are mixed up between parameters. state.history has the first ones of all parameters, then
    the second ones: number i is history i // count of parameter i % count.
    """

    def back() -> None:
        flat = [arrays[i].copy() for i in range(len(solver.history[0])) for arrays in solver.history]
        per_parameter = len(solver.history[0])
        for i, array in enumerate(flat):
            solver.history[i // per_parameter][i % per_parameter][...] = array

    return back


def _layers(solver: Solver) -> Back:
    """The states of the layers are not restored: which row of the data comes next, and what random numbers.
    layer_states() belongs into the state, and _restore_layers takes it back.
    """
    states = solver.net.layer_states()
    return lambda: solver.net.restore_layer_states(states)


def _cursor(solver: Solver) -> Back:
    """The data start anew: the state of the data layer has a cursor, which says the row that comes next."""
    states = {name: state for name, state in solver.net.layer_states().items() if "cursor" in state}
    return lambda: solver.net.restore_layer_states(states)


def _random_numbers(solver: Solver) -> Back:
    """The layers' random numbers start anew, so dropout draws other masks: the states of their generators belong to the
    state of a training.
    """
    states = {name: state for name, state in solver.net.layer_states().items() if "rng" in state}
    return lambda: solver.net.restore_layer_states(states)


def _train(part: Functions, iterations: int, tell: Tell) -> Array:
    """Half of the iterations, a snapshot, the other half in another solver."""
    half = iterations // 2
    with network.frames() as folder:

        def make(seed: int) -> Solver:
            return network.solver_of(network.net_text(folder), seed=seed)

        begun = network.trained(make(1), half, tell)
        with interrupted(part, make, half) as solver:
            return np.concatenate([begun, network.trained(solver, iterations - half, tell)])


FALLING = 'base_lr: 0.1 lr_policy: "step" stepsize: 3 gamma: 0.5'
MOMENTUM = f"{FIXED} momentum: 0.9"
EXERCISE = Exercise(
    name="resume",
    title="A resume that is exact",
    chapter=7,
    file="netlib/training/resume.py",
    to_do={
        "state_of": "Return the SolverState of the solver: its iteration, steps_taken(solver.param, "
        "solver.iter), str(learned_net), the histories in one list, and extra_state(solver). "
        "solver.history has for each parameter the list of its histories; the file has the first "
        "histories of all parameters, then the second ones, as Caffe.",
        "extra_state": "Return, as plain values (snapshot.as_plain), what Caffe has no place for: solver (_course), "
        "smoothed (the losses that are averaged), layers (layer_states() of solver.net and of each test net); "
        "and ranks, the list of others, if there are any.",
        "restore_state": "Read the state (snapshot.read_state), find its weights (snapshot.pair_of) and take back "
        "all of it: the weights, solver.history, solver.iter, solver.smoothed, the states of the "
        "layers (_restore_layers, of _states_of_rank).\n"
        "writes, _, _ = weights_of.fitting(solver.net, weights, strict=True), then "
        "weights_of.write(writes), copies weights. (Ours also checks the histories first, and "
        "says in the log what it does.)",
    },
    names=("state_of", "extra_state", "restore_state"),
    part_of=lambda module: Functions(module.state_of, module.restore_state),
    ours=OURS,
    checks=(
        Check("exact: the weights, and which iteration it is", (
            _case("the same batch each time", SAME),
            _case("a rate that falls every 3 iterations", SAME, FALLING),
            _case("average_loss: 6", SAME, f"{FIXED} average_loss: 6"),
        )),
        Check("exact: the histories", (
            _case("momentum: 0.9", SAME, MOMENTUM),
            _case("Adam, with two histories", SAME, f'{MOMENTUM} type: "Adam" momentum2: 0.99'),
        )),
        Check("exact: the data", (
            _case("rows of a file in order", ROWS % ("rows.txt", "")),
            _case("rows of a file in a new order each time", ROWS % ("rows.txt", "shuffle: true")),
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
    last="the paper's network, a stop in the middle of {} iterations: the losses are those without a stop",
    drift=0,
)  # fmt: skip
