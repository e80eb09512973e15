"""Engines: how a net is computed.

An engine makes the list of steps that the net's loop runs (net.py).

    plain   a step for each layer of layers/, on the whole batch, in the order of the
            file; this file
    fast    the same results, up to rounding, faster: some steps run several layers in slices of the
            batch; folder fast/

``netlib.Net(..., engine="plain")`` selects it for one net, NETLIB_ENGINE for a process; the default
is ``fast`` if the folder fast/ exists.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from netlib.blob import Array, Blob, Blobs
from netlib.building.splits import share_splits
from netlib.errors import NetlibError, did_you_mean
from netlib.files.own_modules import own_module
from netlib.files.paths import ROOT
from netlib.layer import Layer, warn
from netlib.layer_errors import LayerErrors, lacking
from netlib.system import memory

T = TypeVar("T")
NAMES = ("fast", "plain")
# The mark of values that a backward has to write. It is a normal float32 so small that a backward
# that adds to it computes what it would from 0.
UNWRITTEN = 1.2345678e-38


@dataclass(eq=False)  # each is its own key
class Connection:
    """A layer of a net with its bottom and top blobs.

    propagate_down  for each bottom, whether backward computes its gradient
    needs_backward  whether backward has to run
    has_run_back    whether backward has run before
    blobs           the bottoms, then the tops
    errors          the context that names the layer in errors of its methods
    """

    layer: Layer
    bottom: Blobs
    top: Blobs
    propagate_down: list[bool]
    needs_backward: bool = False
    has_run_back: bool = False

    def __post_init__(self) -> None:
        self.blobs = [*self.bottom, *self.top]
        self.errors = LayerErrors(self.layer, self.bottom)


def versions_of(blobs: Iterable[Blob]) -> tuple[int, ...]:
    """The versions of blobs; a reshape changes them."""
    return tuple([blob.version for blob in blobs])


def writes_only_tops(layer: Layer) -> bool:
    """Whether forward writes nothing that other layers read, except its tops.

    A layer of the user can write anything, and moving averages may be shared by their names.
    """
    shares = any(param.name for param in layer.spec.param)
    return layer.type != "Python" and not (layer.moving and shares)


class Missing(NamedTuple):
    """What a step could not store of its last pass.

    halves  for each blob, which of "data" and "diff" are unknown
    layers  those that do not keep what backward reads, so that they have to run again before it
    """

    halves: dict[Blob, frozenset[str]]
    layers: Sequence[Connection] = ()


class Step:
    """One layer, run on the whole batch, with all blobs stored. Steps that run several layers, or
    store fewer blobs, derive from it.

    A forward pass calls ``begin`` of all steps, then ``prepare`` and ``forward`` of each in
    turn; a backward pass calls ``backward`` of each, in reverse. Both end with ``finish`` of all.
    Between passes, a caller's access to a blob calls ``keep`` or ``store``; other steps replace
    this one after its ``store``.

    at           the first layer
    connections  the layers that the step runs
    unstored     the blobs between these layers that the step does not store
    sources      the blobs from which it computes them later, unless it has copies (``keep``)
    lost         set by ``prepare`` if it makes the step store its blobs from now on: what it
                 could not store of the last pass. The net notes it and sets it to None.
    """

    unstored: Sequence[Blob] = ()
    sources: Sequence[Blob] = ()
    lost: Missing | None = None

    def __init__(self, at: Connection) -> None:
        self.at = at
        self.connections = [at]

    def begin(self) -> None:
        """Called when a forward pass begins, which may fail before it reaches this step."""

    def prepare(self) -> None:
        """Prepare for a forward pass with the current shapes."""

    def forward(self) -> None:
        """Reshape the tops and compute them."""
        at = self.at
        with at.errors:
            at.layer.reshape(at.bottom, at.top)
            at.layer.forward(at.bottom, at.top)

    def backward(self, at_once: bool = False) -> None:
        """Compute the diffs, if needed.

        The first backward of a Python layer reports what it leaves unwritten.

        at_once  backward follows forward directly, so that callers cannot have written blobs
        """
        at = self.at
        if not at.needs_backward:
            return
        is_checked = at.layer.type == "Python" and not at.has_run_back
        with at.errors, _all_written(at) if is_checked else nullcontext():
            at.layer.backward(at.top, at.propagate_down, at.bottom)
        at.has_run_back = True

    def finish(self) -> None:
        """Called at the end of a pass. From then on, callers may write sources in arrays that
        they have kept, without an access to the blob.
        """

    def keep(self, source: Blob) -> None:
        """Called before a caller may write this source: keep what the step still needs of it."""

    def store(self) -> Missing:
        """Store the unstored blobs with their values in the last pass, and let the layers keep what
        backward reads. Here nothing is unstored.
        """
        return Missing({})

    def pieces(self) -> list[list[Connection]]:
        """The layers in execution order, for a timer: one list per slice of the batch;
        here there is one.
        """
        return [[self.at]]

    def has_state(self) -> bool:
        """Whether backward still has what forward keeps for it, if the layers have run."""
        return True


@contextmanager
def _all_written(at: Connection) -> Iterator[None]:
    """Context manager around a layer's backward: set what it leaves unwritten of the diffs of its
    bottoms to 0, as in Caffe, with a warning.
    """
    to_write = [
        (name, blob)
        for name, blob, down in zip(at.layer.spec.bottom, at.bottom, at.propagate_down)
        if down and blob not in at.top
    ]
    for _, blob in to_write:
        blob.diff.fill(UNWRITTEN)
    yield
    for name, blob in to_write:
        _clear_unwritten(at.layer, name, blob)


def _clear_unwritten(layer: Layer, name: str, blob: Blob) -> None:
    """Set the values that still have the mark UNWRITTEN in the diff of a bottom to 0, with a
    warning if there are any.
    """
    unwritten = blob.diff == np.asarray(UNWRITTEN, blob.dtype)
    count = unwritten.sum()
    if not count:
        return
    blob.diff[unwritten] = 0
    part = "the diff" if count == blob.count else f"{count} of {blob.count} values of the diff"
    warn(
        layer,
        f"backward of {type(layer).__name__} does not write {part} of bottom {name!r}; "
        "what is not written is 0, as in Caffe: write every element, or set propagate_down: false",
    )


class Engine:
    """The interface of an engine, and the plain engine.

    The fast one (fast/engine.py) overrides its methods.
    """

    name = "plain"

    def steps(
        self, connections: Sequence[Connection], outside: Iterable[Blob], old: Sequence[Step]
    ) -> Sequence[Step]:
        """The steps of a net, forwards; those of ``old`` that still fit are used again.

        ``outside`` are the blobs that a caller reads or writes: inputs, outputs, losses. They are
        always stored.
        """
        share_splits(connections)
        return old or self.steps_by_layer(connections)

    def steps_by_layer(self, connections: Sequence[Connection]) -> Sequence[Step]:
        """The steps of a net of which parts are run, or all blobs read: one for each layer; all
        blobs are stored.
        """
        return [Step(at) for at in connections]

    def implementation(self, cls: type[T]) -> type[T]:
        """The class that this engine uses in place of ``cls``, with the same results."""
        return cls

    def blob(self, dtype: DTypeLike) -> Blob:
        """Create a blob of a net."""
        return Blob((), dtype)

    def run(self, jobs: Sequence[Callable[[], None]], values: float = float("inf")) -> None:
        """Run independent jobs, which process this total number of values, and return
        when all are done.
        """
        for job in jobs:
            job()

    def copy(self, source: Array, target: Array) -> None:
        """Copy the values of one array into another."""
        target[...] = source

    def threads(self) -> int:
        """Number of threads in use."""
        return 1

    def set_threads(self, count: int) -> None:
        """Set the number of threads. Has no effect in this engine."""
        if count < 1:
            raise ValueError(f"the number of threads must be at least 1, got {count}")


# ------------------------------------------------------------------------------------------- choice


def available_cpus() -> int:
    """Number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@functools.cache
def has_fast() -> bool:
    """Whether the fast engine is available."""
    return (ROOT / "fast" / "engine.py").is_file()


def get(name: str | None = None, default: str | None = None) -> Engine:
    """Return an engine by name; by default that of NETLIB_ENGINE, else ``default``, else
    "fast" if available.

    Raises NetlibError.
    """
    name = name or os.environ.get("NETLIB_ENGINE") or default
    return _engine(name or ("fast" if has_fast() else "plain"))


def for_each(items: Iterable[T], job: Callable[[T], None]) -> None:
    """Call ``job`` with every item, in any order, on the threads of the default engine; the plain
    engine has one.
    """
    get().run([functools.partial(job, item) for item in items])


@functools.cache
def _engine(name: str) -> Engine:
    if name == "plain":
        return Engine()
    if name != "fast":
        raise NetlibError(
            f"unknown engine {name!r}{did_you_mean(name, NAMES)}; known: {', '.join(NAMES)}"
        )
    if not has_fast():
        raise NetlibError(
            "the engine 'fast' needs the folder fast/, which is missing; use the engine 'plain'"
        )
    own_module("layers")  # from which fast/ imports
    fast: Engine = own_module("fast.engine").FastEngine()
    return fast


# ------------------------------------------------------------------------------------------- memory


def check_memory(steps: Sequence[Step]) -> None:
    """Raise memory.OutOfMemoryError if the parameters and the stored tops of all layers do not fit
    in memory together.
    """
    connections = [at for step in steps for at in step.connections]
    unstored = {blob for step in steps for blob in step.unstored}
    writers = {top: at.layer for at in connections for top in at.top if top not in unstored}
    params = {blob for at in connections for blob in at.layer.blobs}
    needed = sum(blob.bytes for blob in [*params, *writers] if blob.owns_memory)
    try:
        memory.check(needed, "for all blobs of the net")
    except memory.OutOfMemoryError as error:
        largest = max(writers, key=lambda top: top.bytes)
        raise lacking(writers[largest], "forward", error) from error
