"""The snapshots of a training: their names, the process that may write them, and the last one."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from netlib.errors import DivergenceError
from netlib.snapshots import hdf5_format, snapshot, weights
from netlib.training import resume

log = logging.getLogger("netlib")


class Solver(resume.Solver, Protocol):
    """The attributes of a solver that are used here."""

    source: str


class Snapshots:
    """The snapshots of a solver."""

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self._prefixes: dict[str, Path] = {}  # snapshot_prefix -> its path at the first use
        self.last: Path | None = None  # the last solver state written or read

    @property
    def prefix(self) -> Path:
        """The path that names start with: snapshot_prefix, by default the solver's path without suffix.

        If it is a directory, the solver's name is appended. A directory created after the first use has no effect.
        """
        given, source = self._solver.param.snapshot_prefix, Path(self._solver.source)
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
        return self.last is not None and self.last.absolute() == self.paths(self._solver.iter)[1].absolute()

    @property
    def are_written(self) -> bool:
        """Whether the training writes snapshots."""
        return bool(self._solver.param.snapshot or self._solver.param.snapshot_after_train)

    @contextlib.contextmanager
    def reserved(self) -> Iterator[None]:
        """Context manager: no other process writes snapshots of this prefix, and this one will be able to."""
        solver = self._solver
        if solver.ranks.rank or not self.are_written:
            yield
            return
        with snapshot.prefix_in_use(self.prefix):
            if solver.param.snapshot_format == "HDF5":
                hdf5_format.check_names(weights.owned(solver.net))
            resume.extra_state(solver)  # fails now, not after hours, if the state of a layer cannot be stored
            yield

    def write(self) -> Path:
        """Write weights and solver state; returns the path of the state. Raises WeightsError, DivergenceError."""
        solver = self._solver
        for param in solver.net.learnable:
            if not np.isfinite(param.blob.data).all():
                raise DivergenceError(
                    f"iteration {solver.iter}: parameter {param.index} of layer {param.layer!r} is not finite, so no "
                    "snapshot is written. Lower base_lr or set clip_gradients; the last snapshot is untouched"
                )
        weights_path, state_path = self.paths(solver.iter)
        ranks = solver.ranks
        others = ranks.gather(snapshot.as_plain(solver.net.layer_states())) if ranks.count > 1 else []

        def write() -> None:
            kind = "HDF5" if solver.param.snapshot_format == "HDF5" else "binary proto"
            log.info("Snapshotting to %s file %s", kind, weights_path)
            log.info("Snapshotting solver state to %s file %s", kind, state_path)
            image = weights.image(solver.net, weights_path, solver.param.snapshot_diff)
            snapshot.write_pair(image, resume.state_of(solver, weights_path, others), weights_path, state_path)

        ranks.at_root(write, lambda: solver.requested)
        self.last = state_path
        return state_path
