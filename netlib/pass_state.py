"""The state of a net's passes: what runs, what has run, and which blobs have its values.

A lean net does not store all blobs: its engine leaves some out (``Step.unstored``). The first
access to an unstored blob stores all of them, with the values of the last pass, and the net stores
every blob from then on. An access to what no step can compute is an error.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import numpy as np

from netlib.blob import Array, Blob
from netlib.building.splits import copies_of, renew_splits, share_splits, used_by_python
from netlib.engine import Connection, Missing, Step, check_memory, versions_of, writes_only_tops
from netlib.errors import NetlibError
from netlib.graph import Graph
from netlib.snapshots import snapshot

WHY_UNKNOWN = {
    "data": "the data of blob %r is unknown: the last pass did not complete; run forward again",
    "diff": "the diff of blob %r is unknown: it was not stored, and its backward pass did not complete "
    "or a forward pass came after it; read it directly after backward, or call net.store_all() before",
}


class PassState:
    """The state of the passes of a net, whose loop runs the steps.

    steps        what a pass runs, in order (engine.py)
    one_thread   held while the net is in use
    is_reshaped  whether the steps fit the shapes; an interrupted reshape is repeated
    """

    def __init__(self, graph: Graph) -> None:
        self.steps: Sequence[Step] = []
        self.one_thread = OneThread(graph.name)
        self.is_reshaped = False
        self._name = graph.name
        self._engine = graph.engine
        self._connections = graph.connections
        self._blobs = graph.blobs
        self._losses = graph.losses
        self._parameters = graph.parameters
        named = [graph.blobs[name] for name in [*graph.inputs, *graph.outputs]]
        self._outside = named + [blob for blob, _, _ in graph.losses]
        self._in_place = {blob for at in graph.connections for blob in at.top if blob in at.bottom}
        # number of a loss -> the diff array that holds its weight
        self._seeded: dict[int, Array] = {}
        # versions of the blobs in the last complete forward pass of a layer
        self._ran: dict[Connection, tuple[int, ...]] = {}
        # "data", "diff" or both of blobs of which neither memory nor a step has the values
        self._unknown: dict[Blob, set[str]] = {}
        self._writing: list[tuple[Blob, str]] = []  # what the running step makes known
        self._writes_only_tops = all(writes_only_tops(at.layer) for at in graph.connections)
        self._follows = False  # whether the next backward runs directly after forward
        self._is_at_once = False  # whether the running one does
        self._is_running = False  # whether a pass has begun and not ended
        self._fits = False  # whether the check for memory has passed
        self._watched: set[Blob] = set()  # the blobs whose accesses are noted
        self._unstored: set[Blob] = set()  # the unstored blobs of all steps
        self._apart: set[Blob] = set()  # copies of Split layers with memory of their own
        # the steps that compute unstored blobs from a blob
        self._sources: dict[Blob, list[Step]] = {}
        self._by_layer = False  # whether there is a step for each layer, so that a part can run
        self._stores_less = False  # whether the next full pass need not run by layer
        self._make_steps()
        self.seed_losses()

    # -------------------------------------------------------------------------------------- running

    @contextmanager
    def running(self) -> Iterator[None]:
        """Context manager of a pass: in one thread; an unstored blob cannot be read meanwhile."""
        # the solver reports values that are not finite
        with self.one_thread, np.errstate(all="ignore"), self._parameters.own_shapes():
            self._is_running = True
            self._writing = []
            try:
                yield
            except BaseException:
                for blob, half in self._writing:  # the last step may not have written them
                    self._unknown[blob].add(half)
                raise
            finally:
                for step in self.steps:
                    step.finish()
                self._is_running = False

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Context manager of a backward pass directly after a forward pass.

        Only the layers can have written anything between the two.
        """
        self._follows = self._writes_only_tops
        try:
            yield
        finally:
            self._follows = False

    def begin_forward(self, first: int, last: int | None) -> None:
        """Prepare the steps for a forward pass of this range of layers."""
        self._begin(first, last)
        if self._stores_less:
            self._by_layer = self.is_reshaped = False
            self._make_steps()
            self._stores_less = False
        if first:
            renew_splits(self._connections, first)
        if not self._fits:
            check_memory(self.steps)
            self._fits = True
        for step in self.steps:
            step.begin()

    def forward(self, step: Step) -> None:
        """Run a step forwards, and note what has run."""
        for at in step.connections:
            self._ran.pop(at, None)
        step.prepare()
        if step.lost is not None:
            self._note(step.lost)
            self._use(self.steps)
            step.lost = None
        self._will_write("data", step)
        step.forward()
        for at in step.connections:
            self._ran[at] = versions_of(at.blobs)

    def begin_backward(self, first: int, last: int | None) -> None:
        """Prepare the steps for a backward pass of this range of layers; those that have not run
        forwards do.
        """
        self._is_at_once = self._follows
        self._follows = False
        self._begin(first, last)
        if not self._is_at_once:
            kept = self._unstored | used_by_python(self._connections)
            renew_splits(self._connections, kept=kept)
        if not all(map(self._is_ready, self.steps[first:last])):
            self._run_missing(first, last)

    def backward(self, step: Step) -> None:
        """Run a step backwards."""
        self._will_write("diff", step)
        step.backward(self._is_at_once)

    def _begin(self, first: int, last: int | None) -> None:
        """Let the steps fit the shapes, with one for each layer to run a part."""
        if not self.is_reshaped:
            self.reshape()
        if (first, last) != (0, None):
            self.store_all()

    def _has_run(self, at: Connection) -> bool:
        """Whether forward of a layer has run with the current shapes."""
        return self._ran.get(at) == versions_of(at.blobs)

    def _is_ready(self, step: Step) -> bool:
        """Whether backward of a step can run."""
        return step.has_state() and all(map(self._has_run, step.connections))

    def _run_missing(self, first: int, last: int | None) -> None:
        """Run forwards, once, the layers whose backward will run and that have not run with the
        current shapes. Blobs that another layer has read keep their data.

        Raises NetlibError if such a layer reads data or draws random numbers: this would change
        the next pass.
        """
        self.reshape()
        self.store_all()
        missing = [step for step in self.steps[first:last] if not self._is_ready(step)]
        read = {blob.root for at in self._connections if self._has_run(at) for blob in at.bottom}
        for step in missing:
            [at] = step.connections
            layer = at.layer
            if not layer.spec.bottom and not layer.is_input:
                raise layer.fail(
                    "backward was called before forward, which reads data: run forward first"
                )
            before = snapshot.as_plain(type(layer).state(layer))
            kept = [(blob, blob.data.copy()) for blob in at.top if blob.root in read]
            self.forward(step)
            for blob, data in kept:  # before a later layer reads them
                blob.data[...] = data
            if snapshot.as_plain(type(layer).state(layer)) != before:
                type(layer).restore(layer, before)
                raise layer.fail(
                    "backward was called before forward, which draws random numbers: run forward first"
                )

    def seed_losses(self, is_backward: bool = False) -> None:
        """Set the diff of each loss to its weight: the loss is the sum of loss_weight x top, so
        dL/dtop = loss_weight.

        As in Caffe, the weight is written once per array, so a value that the user writes over it
        is kept. If a layer in place overwrites it, it is written before each backward pass.
        """
        for i, (blob, weight, _) in enumerate(self._losses):
            diff = blob.diff
            seeded = self._seeded.get(i)
            is_new = seeded is None or not np.may_share_memory(seeded, diff)
            if is_new or (is_backward and blob in self._in_place):
                diff[...] = weight
                self._seeded[i] = diff

    # ---------------------------------------------------------------------------------------- steps

    def reshape(self) -> None:
        """Reshape all blobs, and make the steps for their shapes."""
        self.is_reshaped = self._fits = False
        for at in self._connections:
            with at.errors:
                at.layer.reshape(at.bottom, at.top)
        self._make_steps()
        self.seed_losses()

    def _make_steps(self) -> None:
        """Make the steps for the current shapes, unless there is one for each layer already."""
        if not self._by_layer:
            old = self.steps
            with self._sharing():
                new = self._engine.steps(self._connections, self._outside, self.steps)
            for step in old:
                if step not in new:  # values of the last pass that keep their shape are not lost
                    self._note(step.store())
            self._use(new)
        self.is_reshaped = True

    @contextmanager
    def _sharing(self) -> Iterator[None]:
        """Context manager: copies of Split layers get other memory, with the same values, so that
        what has run has still run.
        """
        ran = [at for at in self._connections if self._has_run(at)]
        yield
        self._ran |= {at: versions_of(at.blobs) for at in ran}

    def store_all(self, wanted: bool = True) -> None:
        """From now on run a step for each layer, which stores all blobs, with the values of
        the last pass; or store only the needed ones from the next full pass on.
        """
        self._stores_less = self._by_layer and not wanted
        if self._by_layer or not wanted:
            return
        self.is_reshaped = False  # until all is done
        by_layer = self._engine.steps_by_layer(self._connections)
        with np.errstate(all="ignore"):
            for step in self.steps:
                self._note(step.store())
        with self._sharing():
            share_splits(self._connections)  # all copies are stored
        self._use(by_layer)
        self._by_layer = self.is_reshaped = True

    @property
    def stores_all(self) -> bool:
        """Whether every blob is stored, also by the next full pass."""
        return self._by_layer and not self._stores_less

    def _use(self, steps: Sequence[Step]) -> None:
        """Run these steps from now on.

        At any time the blobs that the old or the new ones do not store are watched.
        """
        state = weakref.ref(self)
        unstored = {blob for step in steps for blob in step.unstored}
        sources: dict[Blob, list[Step]] = {}
        for step in steps:
            for blob in step.sources:
                sources.setdefault(blob, []).append(step)
        before = self._watched
        self._apart = {copy for _, copy, _ in copies_of(self._connections) if copy.owns_memory}
        self._watched = unstored | sources.keys() | self._unknown.keys() | self._apart
        for blob in self._watched:
            is_source = blob not in unstored and blob not in self._unknown
            blob.on_access = partial(_look, state, is_source)
        self.steps, self._unstored, self._sources = steps, unstored, sources
        for blob in before - self._watched:
            blob.on_access = None

    def look(self, blob: Blob, half: str) -> None:
        """Store all blobs before the first access to an unstored one, and let steps keep a source.

        Raises NetlibError if an unstored blob is read during a pass, or cannot be computed.
        """
        if half != "diff" and not self._is_running:
            for step in self._sources.get(blob, ()):
                step.keep(blob)
                if half == "memory":  # steps depend on who has it
                    self.is_reshaped = False
        if half == "memory":
            return
        is_written = blob in self._apart and half == "data" and not self._is_running
        if blob in self._unstored or is_written:
            self._store_before_access()
        if half in self._unknown.get(blob, ()):
            names = {other: name for name, other in self._blobs.items()}
            raise NetlibError(WHY_UNKNOWN[half] % names[blob])

    def _store_before_access(self) -> None:
        with self.one_thread:
            if self._is_running:
                raise NetlibError(
                    f"net {self._name!r}: an unstored blob is read during a pass; read it once "
                    "before, so that the net stores all blobs"
                )
            self.store_all()

    # ------------------------------------------------------------------------------ what is missing

    def _note(self, missing: Missing) -> None:
        """Note what a step could not store."""
        self._unknown |= {blob: set(halves) for blob, halves in missing.halves.items()}
        for at in missing.layers:
            self._ran.pop(at, None)

    def _will_write(self, half: str, step: Step) -> None:
        """Note that a step writes this half of its blobs, unless it also reads them."""
        if not self._unknown:
            return
        self._writing = []
        for at in step.connections:
            written, read = (at.top, at.bottom) if half == "data" else (at.bottom, at.top)
            for blob in written:
                if half in self._unknown.get(blob, ()) and blob not in read:
                    self._unknown[blob].discard(half)
                    self._writing.append((blob, half))


class OneThread:
    """Context manager for one thread at a time, which may enter again; another gets a NetlibError,
    because two threads that run one net would mix up their batches. ``name`` is that of the net.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise NetlibError(
                f"net {self._name!r} is in use by another thread; use a separate net in each thread "
                "(share_params gives them the same weights), or serialize the calls"
            )

    def __exit__(self, *exception: object) -> None:
        self._lock.release()


def _look(state: weakref.ref[PassState], is_source: bool, blob: Blob, half: str) -> None:
    """An access to a blob that its net watches. Raises NetlibError."""
    known = state()
    if known is None:
        if is_source:
            return
        raise NetlibError("this blob is unstored and its net is gone; read it, or copy it, before")
    known.look(blob, half)
