"""The snapshots of a training: collect its state in a solver state, write it, and
restore it exactly.

For a resume that is exact to the bit, a state contains, in addition to Caffe's iteration and
histories, the random generators and data positions of all layers and the losses being averaged.
States written by Caffe have none of these.
"""

from __future__ import annotations

import contextlib
import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import numpy as np

from netlib.blob import Array
from netlib.distributed.ranks import Ranks, Request, moving
from netlib.errors import DivergenceError, WeightsError, reason_of
from netlib.net import Net
from netlib.proto.messages import SolverParameter
from netlib.snapshots import hdf5_format, snapshot
from netlib.snapshots import weights as weights_of
from netlib.snapshots.solver_state import SolverState
from netlib.updates import steps_taken

log = logging.getLogger("netlib")

# Options of a solver that affect the course of a training. A resume logs those that have changed.
COURSE = (
    "type",
    "base_lr",
    "lr_policy",
    "gamma",
    "power",
    "stepsize",
    "stepvalue",
    "rampup_interval",
    "rampup_lr",
    "max_iter",
    "iter_size",
    "momentum",
    "momentum2",
    "rms_decay",
    "delta",
    "weight_decay",
    "regularization_type",
    "clip_gradients",
)


class Training:
    """The state of a training, which snapshots store and restore. A Solver (netlib/solver.py) is
    one, and documents its attributes.
    """

    param: SolverParameter
    source: str
    ranks: Ranks
    requested: Request | None
    net: Net
    test_nets: list[Net]
    history: list[list[Array]]
    iter: int
    smoothed: deque[float]

    @property
    def nets(self) -> list[Net]:
        """The training net and the test nets."""
        return [self.net, *self.test_nets]


class Snapshots:
    """The snapshots of a solver."""

    def __init__(self, solver: Training) -> None:
        self._solver = solver
        self._prefixes: dict[str, Path] = {}  # snapshot_prefix -> its path at the first use
        self.last: Path | None = None  # the last solver state written or read

    @property
    def prefix(self) -> Path:
        """The path that names start with: snapshot_prefix, by default the solver's path
        without suffix.

        If it is a directory, the solver's name is appended. A directory created after the first use
        has no effect.
        """
        given = self._solver.param.snapshot_prefix
        source = Path(self._solver.source)
        if not given:
            return source.with_suffix("")
        if given not in self._prefixes:
            is_folder = given.endswith("/") or Path(given).is_dir()
            self._prefixes[given] = Path(given) / source.stem if is_folder else Path(given)
        return self._prefixes[given]

    def paths(self, iteration: int) -> tuple[Path, Path]:
        """Paths of the weights and the solver state after ``iteration`` updates."""
        stem = f"{self.prefix}_iter_{iteration}"
        suffix = ".h5" if self._solver.param.snapshot_format == "HDF5" else ""
        return Path(f"{stem}.caffemodel{suffix}"), Path(f"{stem}.solverstate{suffix}")

    def is_current(self) -> bool:
        """Whether the last solver state written or read is that of this iteration."""
        _, state_path = self.paths(self._solver.iter)
        return self.last is not None and self.last.absolute() == state_path.absolute()

    @property
    def are_written(self) -> bool:
        """Whether the training writes snapshots."""
        return bool(self._solver.param.snapshot or self._solver.param.snapshot_after_train)

    @contextlib.contextmanager
    def reserved(self) -> Iterator[None]:
        """Context manager: no other process writes snapshots of this prefix, and this one
        will be able to.
        """
        solver = self._solver
        if solver.ranks.rank or not self.are_written:
            yield
            return
        with snapshot.prefix_in_use(self.prefix):
            if solver.param.snapshot_format == "HDF5":
                hdf5_format.check_names(weights_of.owned(solver.net))
            # fails now, not after hours, if the state of a layer cannot be stored
            extra_state(solver)
            yield

    def write(self) -> Path:
        """Write weights and solver state; returns the path of the state.

        Raises WeightsError, DivergenceError.
        """
        solver = self._solver
        for param in solver.net.learnable:
            if not np.isfinite(param.blob.data).all():
                raise DivergenceError(
                    f"iteration {solver.iter}: parameter {param.index} of layer {param.layer!r} is not finite, so no "
                    "snapshot is written. Lower base_lr or set clip_gradients; the last snapshot is untouched"
                )
        weights_path, state_path = self.paths(solver.iter)
        ranks = solver.ranks
        others = ranks.everyone(snapshot.as_plain(solver.net.layer_states()))[1:]

        def write() -> None:
            kind = "HDF5" if solver.param.snapshot_format == "HDF5" else "binary proto"
            log.info("Snapshotting to %s file %s", kind, weights_path)
            log.info("Snapshotting solver state to %s file %s", kind, state_path)
            image = weights_of.image(solver.net, weights_path, solver.param.snapshot_diff)
            snapshot.write_pair(
                image, state_of(solver, weights_path, others), weights_path, state_path
            )

        ranks.at_root(write, lambda: solver.requested)
        self.last = state_path
        return state_path


def state_of(
    solver: Training, learned_net: Path, others: Sequence[Mapping[str, Any]] = ()
) -> SolverState:
    """Content of the solver state that goes with the weights ``learned_net``.

    ``others`` are the layer states of ranks 1 and up. Raises TypeError if the state of a layer
    cannot be stored.
    """
    return SolverState(
        solver.iter,
        steps_taken(solver.param, solver.iter),
        str(learned_net),
        _histories(solver),
        extra_state(solver, others),
    )


def _histories(solver: Training) -> list[Array]:
    """The arrays of the update rule in Caffe's order: the first of every parameter, then the
    second.
    """
    return [array for arrays in zip(*solver.history) for array in arrays]


def extra_state(solver: Training, others: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """State beyond Caffe's format; ``others`` are the layer states of ranks 1 and up."""
    extra = {
        "solver": _course(solver),
        "smoothed": list(solver.smoothed),
        "layers": [net.layer_states() for net in solver.nets],
        # affects rounding
        "stores_all": [net.stores_all for net in solver.nets],
    }
    if others:
        extra["ranks"] = list(others)
    return snapshot.as_plain(extra)


def _course(solver: Training) -> dict[str, Any]:
    """Values of the options in ``COURSE``, with the batch size and the number of ranks."""
    shape = next((at.top[0].shape for at in solver.net.connections if at.top), ())
    course = {name: getattr(solver.param, name) for name in COURSE}
    return {**course, "batch": shape[0] if shape else 0, "ranks": solver.ranks.count}


def restore_state(solver: Training, path: str | Path) -> None:
    """Restore a solver state completely or not at all. Raises WeightsError."""
    try:
        state = snapshot.read_state(path)
        weights = snapshot.weights_of(path, state)
    except WeightsError as error:
        complete = snapshot.complete_snapshot(path)
        if complete is None:
            raise
        raise WeightsError(f"{error}; the newest complete snapshot is {complete}") from error
    _check_type(solver, path, state)
    _check_histories(solver, path, state)
    writes, _, _ = weights_of.fitting(solver.net, weights, strict=True)
    _restore_layers(solver, path, _states_of_rank(solver, state))
    weights_of.write(writes)  # no errors are possible from here on
    for array, target in zip(state.history, _histories(solver)):
        target[...] = weights_of.legacy_shape(array, target.shape)
    for net, stores_all in zip(solver.nets, state.extra.get("stores_all", [])):
        net.store_all(bool(stores_all))
    solver.iter = state.iter
    solver.smoothed.clear()
    solver.smoothed.extend(state.extra.get("smoothed", []))
    log.info("SGDSolver: restoring history")
    log.info(
        "Resuming at iteration %d: weights from %s, history from %s", solver.iter, weights, path
    )
    _log_restored(solver, state)


def _log_restored(solver: Training, state: SolverState) -> None:
    """Log what of a training the restored state has, and what has changed since."""
    if solver.iter >= solver.param.max_iter:
        log.warning("Nothing is left to train: max_iter is %d", solver.param.max_iter)
    if not state.extra:
        log.info("Written by Caffe: data positions and random numbers are reset")
        return
    if "checksum" not in state.extra:
        log.info("Written by an earlier version, without a checksum: damage cannot be detected")
    changes = list(_changes(solver, state))
    exactly = "" if changes else "; the resume is exact"
    log.info("Restored: data positions, random numbers, averaged loss%s", exactly)
    for change in changes:
        log.info("Changed: %s", change)


def _states_of_rank(solver: Training, state: SolverState) -> list[dict[str, Any]]:
    """The states of the layers of all nets for this rank.

    If the number of ranks is unchanged, each rank gets its own. Otherwise data positions are kept,
    and the random generators of ranks other than 0 are reset.
    """
    nets: list[dict[str, Any]] = list(state.extra.get("layers", []))
    others = state.extra.get("ranks", [])
    if solver.ranks.rank and nets:
        if len(others) == solver.ranks.count - 1:
            nets[0] = others[solver.ranks.rank - 1]
        else:
            nets[0] = {
                layer: {key: value for key, value in values.items() if key != "rng"}
                for layer, values in nets[0].items()
            }
    return nets


@contextlib.contextmanager
def undone_after(kind: type[Exception], nets: Sequence[Net]) -> Iterator[Callable[[], None]]:
    """Context manager: after an error of this kind, restore the data positions, random generators
    and moving averages that the nets had before.

    Yields the function that does so.
    """
    states_before = [net.layer_states() for net in nets]
    averages_before = [(array, array.copy()) for net in nets for array in moving(net)]

    def undo() -> None:
        for net, states in zip(nets, states_before):
            net.restore_layer_states(states)
        for array, values in averages_before:
            array[...] = values

    try:
        yield undo
    except kind:
        undo()
        raise


def _restore_layers(solver: Training, path: str | Path, states: list[dict[str, Any]]) -> None:
    """Restore the states of all layers, or of none. Raises WeightsError."""
    try:
        with undone_after(Exception, solver.nets):
            for net, layer_states in zip(solver.nets, states):
                net.restore_layer_states(layer_states)
    except Exception as error:  # a Python layer can raise anything
        raise WeightsError(
            f"{path}: the state of a layer cannot be restored: {reason_of(error)}"
        ) from error


def _check_type(solver: Training, path: str | Path, state: SolverState) -> None:
    """Check that the state is of a solver of the same type. Raises WeightsError."""
    written = state.extra.get("solver", {}).get("type")
    expected = solver.param.type
    if written not in (None, expected):
        raise WeightsError(
            f"{path}: this state is of the solver type {written}, whose history has another meaning for "
            f'{expected}; expected type: "{written}", or a new training from the weights (--weights)'
        )


def _check_histories(solver: Training, path: str | Path, state: SolverState) -> None:
    """Check the number, shapes and values of the histories. Raises WeightsError."""
    targets = _histories(solver)
    if len(state.history) != len(targets):
        raise WeightsError(
            f"{path}: {len(state.history)} histories, but {solver.param.type} on this net has {len(targets)}; "
            "it is probably from another solver type or net"
        )
    for i, (array, target) in enumerate(zip(state.history, targets)):
        param = solver.net.learnable[i % len(solver.history)]
        if weights_of.legacy_shape(array, target.shape).shape != target.shape:
            raise WeightsError(
                f"{path}: history {i} has shape {array.shape}, "
                f"layer {param.layer!r} parameter {param.index} {target.shape}"
            )
        if array.size and np.abs(array).max() > np.finfo(target.dtype).max:
            raise WeightsError(
                f"{path}: history {i} has values that are too large for {target.dtype}"
            )


def _changes(solver: Training, state: SolverState) -> Iterator[str]:
    """Describe the changes since the state was written that affect the course of the training."""
    old_states = state.extra.get("layers", [])
    if any(map(_reads_other_files, solver.nets, old_states)):
        yield "the data files; reading starts at the first row"
    for net, old in zip(solver.nets, chain(old_states, repeat({}))):
        new_layers = [layer.name for layer in net.layers if layer.name not in old]
        if new_layers:
            yield (
                f"the layers; there is no state of {new_layers[0]!r} in net {net.name!r}, which is reset"
            )
            break
    course = snapshot.as_plain(_course(solver))
    if solver.param.lr_policy != "poly":
        course.pop("max_iter")  # affects the rate only with lr_policy poly
    defaults = snapshot.as_plain({name: getattr(SolverParameter, name) for name in COURSE})
    # older states lack some fields
    old_course = {**defaults, "ranks": 1, **state.extra.get("solver", {})}
    for name, value in course.items():
        old_value = old_course.get(name)
        if value != old_value:
            what = {"batch": "batch size", "ranks": "number of ranks"}.get(name, name)
            yield f"{what} was {_shown(old_value)}, is now {_shown(value)}"


def _reads_other_files(net: Net, old_states: Mapping[str, Any]) -> bool:
    """Whether a layer reads other data files than when ``old_states`` were written."""
    states = snapshot.as_plain(net.layer_states())
    return any(
        values.get("files") != old_states.get(layer, {}).get("files")
        for layer, values in states.items()
    )


def _shown(value: Any) -> str:
    """The value of an option for messages."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
