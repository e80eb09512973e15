"""Go on from a solver state exactly: what such a state holds, how it is restored, and what is said about it.

A training goes on bit for bit if the solver state has, besides Caffe's iteration and histories, the random numbers and
data positions of all layers and the losses that are averaged. States that Caffe wrote have none of these.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from netlib.blob import Array
from netlib.errors import WeightsError, reason_of
from netlib.net import Net
from netlib.proto.messages import SolverParameter
from netlib.snapshots import snapshot
from netlib.snapshots import weights as weights_of
from netlib.snapshots.solver_state import SolverState, contradictions
from netlib.updates import steps_taken

log = logging.getLogger("netlib")

# A solver's options that change the course of a training; a resume says which of them are not what they were.
COURSE = (
    "type", "base_lr", "lr_policy", "gamma", "power", "stepsize", "stepvalue", "rampup_interval", "rampup_lr",
    "max_iter", "iter_size", "momentum", "momentum2", "rms_decay", "delta", "weight_decay", "regularization_type",
    "clip_gradients",
)  # fmt: skip


class Solver(Protocol):
    """What is asked of a solver here."""

    param: SolverParameter
    net: Net
    test_nets: list[Net]
    iter: int
    history: list[list[Array]]
    smoothed: deque[float]


def state_of(solver: Solver, learned_net: Path, others: Sequence[Mapping[str, Any]] = ()) -> SolverState:
    """What a solver state file will hold beside the weights ``learned_net``. Raises TypeError if a layer's cannot.

    others  the layers' states of the ranks from 1 on
    """
    per_parameter = len(solver.history[0]) if solver.history else 0
    histories = [h[i] for i in range(per_parameter) for h in solver.history]  # Caffe's order
    return SolverState(
        solver.iter, steps_taken(solver.param, solver.iter), str(learned_net), histories, extra_state(solver, others)
    )


def extra_state(solver: Solver, others: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """What Caffe has no place for; ``others`` are the layers' states of the ranks from 1 on."""
    extra = {
        "solver": _course(solver),
        "smoothed": list(solver.smoothed),
        "layers": [net.layer_states() for net in [solver.net, *solver.test_nets]],
    }
    return snapshot.as_plain(extra | ({"ranks": list(others)} if others else {}))


def _course(solver: Solver) -> dict[str, Any]:
    """The options of ``COURSE``, the batch size and the number of ranks."""
    first = next((at.top[0].shape for at in solver.net.connections if at.top), ())
    batch = first[0] if first else 0
    return {name: getattr(solver.param, name) for name in COURSE} | {"batch": batch, "ranks": rank_and_count(solver)[1]}


def rank_and_count(solver: Solver) -> tuple[int, int]:
    """Which process of how many this one is; a solver without ``ranks`` trains alone."""
    ranks = getattr(solver, "ranks", None)
    return (0, 1) if ranks is None else (ranks.rank, ranks.count)


def restore_state(solver: Solver, path: str | Path) -> None:
    """Take back a solver state, all of it or nothing. Raises WeightsError."""
    state = snapshot.read_state(path)
    now, steps = snapshot.as_plain(_course(solver)), steps_taken(solver.param, state.iter)
    if fault := next(contradictions(state, now, steps), ""):
        raise WeightsError(f"{path}: {fault}; the state is damaged or was changed")
    _check_histories(solver, path, state)
    weights = snapshot.pair_of(path, state)
    writes, _, _ = weights_of.fitting(solver.net, weights, strict=True)
    _restore_layers(solver, path, _states_of_rank(solver, state))
    weights_of.write(writes)  # from here on nothing fails
    count = len(solver.history)
    for i, array in enumerate(state.history):
        target = solver.history[i % count][i // count]
        target[...] = weights_of.legacy_shape(array, target.shape)
    solver.iter = state.iter
    solver.smoothed.clear()
    solver.smoothed.extend(state.extra.get("smoothed", []))
    log.info("SGDSolver: restoring history")
    log.info("Resuming at iteration %d: weights from %s, history from %s", solver.iter, weights, path)
    if solver.iter >= solver.param.max_iter:
        log.warning("Nothing is left to train: max_iter is %d", solver.param.max_iter)
    if not state.extra:
        log.info("Written by Caffe: data positions and random numbers start anew")
        return
    if "checksum" not in state.extra:
        log.info("Written by an earlier version, without a checksum: damage would not be noticed")
    changes = list(_changes(solver, state))
    exactly = "; the training goes on exactly" if not changes else ""
    log.info("Restored: data positions, random numbers, averaged loss%s", exactly)
    for change in changes:
        log.info("Changed: %s", change)


def _states_of_rank(solver: Solver, state: SolverState) -> list[dict[str, Any]]:
    """The states of the layers of all nets, on this rank.

    Of a training of as many ranks as there are now, those that this rank had. Else the data go on where they were, and
    random numbers of other ranks than 0 start anew.
    """
    nets: list[dict[str, Any]] = list(state.extra.get("layers", []))
    others, (rank, count) = state.extra.get("ranks", []), rank_and_count(solver)
    if rank and nets:
        if len(others) == count - 1:
            nets[0] = others[rank - 1]
        else:
            nets[0] = {name: {k: v for k, v in own.items() if k != "rng"} for name, own in nets[0].items()}
    return nets


def moving(net: Net) -> list[Array]:
    """The parameters that forward changes: running means."""
    return [blob.data for layer in net.layers if layer.moving for blob in layer.blobs]


def undo_of(nets: Sequence[Net]) -> Callable[[], None]:
    """A function that puts data positions, random numbers and running means of the nets back to what they are now."""
    before = [net.layer_states() for net in nets]
    means = [(array, array.copy()) for net in nets for array in moving(net)]

    def undo() -> None:
        for net, states in zip(nets, before):
            net.restore_layer_states(states)
        for array, values in means:
            array[...] = values

    return undo


def _restore_layers(solver: Solver, path: str | Path, states: list[dict[str, Any]]) -> None:
    """Take back the states of all layers, or leave all as they are. Raises WeightsError."""
    nets = [solver.net, *solver.test_nets]
    undo = undo_of(nets)
    try:
        for net, of_layers in zip(nets, states):
            net.restore_layer_states(of_layers)
    except Exception as error:  # of a user's layer, too
        undo()
        raise WeightsError(f"{path}: the state of a layer cannot be restored: {reason_of(error)}") from error


def _check_histories(solver: Solver, path: str | Path, state: SolverState) -> None:
    """As many as the solver has, in its shapes. Raises WeightsError."""
    count = len(solver.history)
    expected = count * len(solver.history[0]) if solver.history else 0
    if len(state.history) != expected:
        raise WeightsError(
            f"{path}: {len(state.history)} histories, but {solver.param.type} on this net has {expected}; "
            "is it from another solver type or net?"
        )
    for i, array in enumerate(state.history):
        param, target = solver.net.learnable[i % count], solver.history[i % count][i // count]
        if weights_of.legacy_shape(array, target.shape).shape != target.shape:
            raise WeightsError(f"{path}: history {i} has shape {array.shape}, "
                               f"layer {param.layer!r} parameter {param.index} {target.shape}")  # fmt: skip
        if array.size and np.abs(array).max() > np.finfo(target.dtype).max:
            raise WeightsError(f"{path}: history {i} has values that are too large for {target.dtype}")


def _changes(solver: Solver, state: SolverState) -> Iterator[str]:
    """What is not as it was when the state was written, and changes the course of the training."""
    if not _same_data(solver, state):
        yield "the data files; they are read from the first row"
    states = state.extra.get("layers", [])
    for i, net in enumerate([solver.net, *solver.test_nets]):
        there = states[i] if i < len(states) else {}
        if new := [layer.name for layer in net.layers if layer.name not in there]:
            yield f"the layers; there is no state of {new[0]!r} in net {net.name!r}, which begins anew"
            break
    now = snapshot.as_plain(_course(solver))
    if solver.param.lr_policy != "poly":
        now.pop("max_iter")  # training longer changes nothing on the way
    defaults = snapshot.as_plain({name: getattr(SolverParameter, name) for name in COURSE})
    then = {**defaults, "ranks": 1, **state.extra.get("solver", {})}  # a state may be older than a field
    for name in now:
        if now[name] != then.get(name):
            what = {"batch": "batch size", "ranks": "number of ranks"}.get(name, name)
            yield f"{what} was {_g(then.get(name))}, is now {_g(now[name])}"


def _same_data(solver: Solver, state: SolverState) -> bool:
    """Do all nets read the files that they read when the state was written?"""
    for net, then in zip([solver.net, *solver.test_nets], state.extra.get("layers", [])):
        for name, now in snapshot.as_plain(net.layer_states()).items():
            if now.get("files") != then.get(name, {}).get("files"):
                return False
    return True


def _g(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
