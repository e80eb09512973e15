"""Callbacks: work attached to a solver, in the shape of Caffe's ``Solver::Callback`` and ``ActionCallback``.

    solver.callbacks.append(Functions(on_update=lambda: losses.append(solver.loss)))

A solver calls its callbacks in the order of their list. ``Rollback`` is always among them; training by several
processes is another one (netlib/distributed/data_parallel.py).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, Protocol

from netlib.blob import Array
from netlib.engine import Engine
from netlib.errors import DataError, NetlibError
from netlib.graph import LayerHook
from netlib.net import Net
from netlib.training import report, resume

log = logging.getLogger("netlib")

Request = Literal["stop", "snapshot"]


class Solver(resume.Solver, Protocol):
    """The attributes of a solver that callbacks use."""

    engine: Engine
    requested: Request | None

    @property
    def loss(self) -> float:
        """Mean loss of the last average_loss iterations."""

    def test_is_due(self) -> bool:
        """Whether the next iteration begins with tests."""


class Callback:
    """Work attached to a solver. Every method does nothing here, and is called when its name says.

    rank, count  this process among those that train together
    layer_hook   called with each layer of the training net before and after its setup
    """

    rank, count = 0, 1
    layer_hook: LayerHook | None = None

    # ------------------------------------------------------------------------------------------ an iteration, in order

    def on_step(self, solver: Solver) -> None:
        """``Solver.step`` begins."""

    def on_iteration(self, solver: Solver) -> None:
        """An iteration begins; its tests, if they are due, come first."""

    def on_start(self, solver: Solver) -> None:
        """The gradients are cleared, and will be computed."""

    def on_gradients_ready(self, solver: Solver) -> None:
        """The gradients are complete, and will be applied."""

    def on_update(self, solver: Solver) -> None:
        """The weights are updated, and ``solver.iter`` counts this iteration."""

    def action(self, request: Request | None) -> Request | None:
        """What to do after an update or after tests, given what was requested so far."""
        return request

    # ------------------------------------------------------------------------------------------ what interrupts it

    def on_test_batch(self, solver: Solver) -> None:
        """A batch of a test net was run."""

    def on_cut(self, solver: Solver) -> None:
        """An iteration ends after its tests, because a stop was requested."""

    def on_restore(self, solver: Solver) -> None:
        """The solver continues from a snapshot."""

    def on_error(self, solver: Solver, error: NetlibError) -> NetlibError:
        """An error occurred; returns the one to raise."""
        return error

    # ------------------------------------------------------------------------------------------ several processes

    def seed(self, chosen: int) -> int:
        """The seed to use, given the one that this process chose."""
        return chosen

    def on_loss(self, solver: Solver, loss: float, with_gradients: bool = True) -> float:
        """A loss was computed, and with it the gradients of an iteration; returns the loss to report."""
        return loss

    def at_root(self, solver: Solver, work: Callable[[], object], seconds: float = 0.0) -> None:
        """Do work that one process does for all, such as writing files, and that may take some seconds."""
        work()

    def outputs(self, net: Net, values: Mapping[str, Array]) -> Mapping[str, Array]:
        """The outputs of a net to report, by name, given those of this process."""
        return values

    def other_states(self, net: Net) -> Sequence[Mapping[str, Any]]:
        """The layer states of the other processes, for a solver state."""
        return ()


class Functions(Callback):
    """A callback made of functions without arguments; with the first two, what ``add_callback`` of pycaffe takes."""

    def __init__(
        self,
        on_start: Callable[[], object] | None = None,
        on_gradients_ready: Callable[[], object] | None = None,
        on_update: Callable[[], object] | None = None,
    ) -> None:
        self._functions = on_start, on_gradients_ready, on_update

    def _call(self, number: int) -> None:
        if (function := self._functions[number]) is not None:
            function()

    def on_start(self, solver: Solver) -> None:
        """Call the first function."""
        self._call(0)

    def on_gradients_ready(self, solver: Solver) -> None:
        """Call the second function."""
        self._call(1)

    def on_update(self, solver: Solver) -> None:
        """Call the third function."""
        self._call(2)


class Rollback(Callback):
    """Undoes an iteration that cannot be completed, so that a resume repeats it with the same rows.

    It restores data positions, random numbers and moving averages if data ends in the middle of an iteration, or if a
    stop is requested during its tests.
    """

    def __init__(self) -> None:
        self._undo: Callable[[], None] | None = None

    def on_step(self, solver: Solver) -> None:
        """Forget the last iteration, which an exception may have left."""
        self._undo = None

    def on_iteration(self, solver: Solver) -> None:
        """Remember the state of the nets that this iteration runs, if reading their data may fail."""
        nets = [solver.net, *solver.test_nets] if solver.test_is_due() else [solver.net]
        self._undo = resume.undo_of(nets) if solver.test_is_due() or any(map(_reads_files, nets)) else None

    def on_gradients_ready(self, solver: Solver) -> None:
        """From here on the iteration is completed."""
        self._undo = None

    def on_cut(self, solver: Solver) -> None:
        """A resume repeats the tests."""
        self._undo_now()

    def on_error(self, solver: Solver, error: NetlibError) -> NetlibError:
        """A resume repeats the iteration, with the data that were missing."""
        if isinstance(error, DataError):
            self._undo_now()
        self._undo = None
        return error

    def _undo_now(self) -> None:
        if self._undo is not None:
            self._undo()
            self._undo = None


def _reads_files(net: Net) -> bool:
    """Whether reading data can fail in this net: a layer reads files or is a Python layer."""
    return any(hasattr(layer, "reads") or layer.type == "Python" for layer in net.layers)


class GradientWarning(Callback):
    """Warns once of a training that changes no weight: its net has no loss, or its first gradients are all 0."""

    ITERATIONS = 3  # whose gradients are examined; those of one batch can be 0, as of a hinge loss without violations

    def __init__(self) -> None:
        self._left = self.ITERATIONS
        self._has_begun = False

    def on_step(self, solver: Solver) -> None:
        """Warn of losses without a loss_weight."""
        if not self._has_begun:
            self._has_begun = True
            for message in report.lack_of_loss(solver.net):
                log.warning("%s", message)
            if not solver.net.losses:
                self._left = 0

    def on_gradients_ready(self, solver: Solver) -> None:
        """Warn if the gradients of all iterations until now were 0."""
        if not self._left:
            return
        learned = [param for param in solver.net.learnable if param.spec.lr_mult]
        if not learned or any(param.blob.diff.any() for param in learned):
            self._left = 0
            return
        self._left -= 1
        if not self._left:
            log.warning("the gradients of all parameters were exactly 0 in the first %d iterations, so no weight "
                        "changes: check that a loss depends on them (propagate_down, layers of constant output such "
                        "as a ReLU of negative values)", self.ITERATIONS)
