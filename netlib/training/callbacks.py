"""Callbacks: work attached to a solver, in the shape of Caffe's ``Solver::Callback`` and ``ActionCallback``.

    solver.callbacks.append(Functions(on_update=lambda: losses.append(solver.loss)))

A solver calls its callbacks in the order of their list. ``Rollback`` is always among them; training by several
processes is another one (netlib/distributed/data_parallel.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, Protocol

from netlib.blob import Array
from netlib.engine.plain import BackwardHook, Engine
from netlib.errors import DataError, NetlibError
from netlib.graph import LayerHook
from netlib.net import Net
from netlib.training import resume

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

    def backward_hook(self) -> BackwardHook | None:
        """The hook of the backward pass that completes the gradients (``Net.run_backward``), if any."""
        return None

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
