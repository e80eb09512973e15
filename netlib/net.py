"""Net: a graph of layers (graph.py) that runs forwards and backwards, loads weights and saves them.

The interface is pycaffe's: ``net.blobs``, ``net.params``, ``net.forward()``, ``net.backward()``,
``net.save()``.
"""

from __future__ import annotations

import logging
import threading
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib import engine as engines
from netlib.blob import Blob
from netlib.building import python_layer
from netlib.engine import Missing, Step, check_memory
from netlib.errors import LayerError, NetlibError, did_you_mean
from netlib.files import Content
from netlib.graph import Graph, LayerHook
from netlib.layer import PHASES, TEST, TRAIN
from netlib.proto import schema
from netlib.proto.messages import NetParameter, NetState
from netlib.proto.net_parameter import load_parameter, select_layers
from netlib.proto.prototxt import Message
from netlib.snapshots import snapshot
from netlib.snapshots import weights as weights_of

log = logging.getLogger("netlib")

_seeds: np.random.Generator | None = None


def set_random_seed(seed: int) -> None:
    """Set the seed from which nets and solvers without a seed draw theirs."""
    global _seeds
    _seeds = np.random.default_rng(seed)


def next_seed() -> int | None:
    """Draw the next seed; None (a new one each run) unless ``set_random_seed`` was called."""
    return None if _seeds is None else int(_seeds.integers(2**31))


class Net:
    """A net of layers.

    ``Net(model, phase)`` or ``Net(model, weights, phase)``; ``model`` is a file or a parsed
    NetParameter. ``engine`` is "plain" or "fast" (netlib/engine.py). ``python_layers=False``
    rejects nets with layers of type Python. ``layer_hook`` is called with each layer before and
    after its setup.

    blobs           name -> Blob, in the order of creation
    params          layer name -> its parameters, for layers that have any
    inputs, outputs names of the blobs that the caller writes, and of those that no layer reads
    layers          the layers in order
    layer_dict      name -> layer
    connections     the layers in order, each with the blobs that it reads and writes
    losses          (blob, loss weight, name) of every loss
    learnable       list of Param, each shared parameter once
    steps           what a pass runs, in order (netlib/engine.py)

    Raises NetlibError (PrototxtError, LayerError, WeightsError) if a file is invalid.
    """

    def __init__(
        self,
        model: str | Path | NetParameter | Message,
        *args: Any,
        phase: int | None = None,
        weights: str | Path | None = None,
        dtype: DTypeLike = np.float32,
        level: int = 0,
        stages: Sequence[str] | None = None,
        state: NetState | None = None,
        seed: int | None = None,
        engine: str | None = None,
        python_layers: bool = True,
        layer_hook: LayerHook | None = None,
    ) -> None:
        for value in args:
            if isinstance(value, (int, np.integer)):
                phase = int(value)
            else:
                weights = value
        self.dtype = np.dtype(dtype)
        if self.dtype not in (np.float32, np.float64):
            raise NetlibError(f"a net computes in float32 or float64, not in {self.dtype}")
        self.source = str(model) if isinstance(model, (str, Path)) else "<net>"
        param = load_parameter(model)
        if phase not in (None, TRAIN, TEST):
            raise NetlibError(
                f"phase {phase} is unknown; expected {TRAIN} (TRAIN) or {TEST} (TEST)"
            )
        phase_name: schema.Phase = param.state.phase if phase is None else ("TRAIN", "TEST")[phase]
        self.state = state or NetState(
            phase_name, level or param.state.level, param.state.stage + tuple(stages or ())
        )
        self.phase = PHASES[self.state.phase]
        self.name = param.name
        self.seed = next_seed() if seed is None else seed
        layers = tuple(select_layers(param, self.state))  # inputs are among them now
        self.param = schema.changed(param, layer=layers, input=(), input_dim=(), input_shape=())
        python_layer.check_allowed(self.param.layer, python_layers)
        self.engine = engines.get(engine)
        graph = Graph(self.param, self.state.phase, self.engine, self.dtype, self.seed, layer_hook)
        self.blobs, self.params, self.losses = graph.blobs, graph.params, graph.losses
        self.inputs, self.outputs, self.learnable = graph.inputs, graph.outputs, graph.learnable
        self.connections, self.layer_dict = graph.connections, graph.layer_dict
        self.layers = list(self.layer_dict.values())
        self._learnable_values = sum(param.blob.count for param in self.learnable)
        self._in_place = {x for at in self.connections for x in at.bottom for y in at.top if x is y}
        # number of a loss -> the diff array that holds its weight
        self._seeded: dict[int, NDArray[Any]] = {}
        self._outside = [self.blobs[name] for name in [*self.inputs, *self.outputs]] + [
            loss[0] for loss in self.losses
        ]
        self.one_thread = OneThread(self.name)
        self._writing: list[tuple[Unknown, str]] = []  # what the running step makes known
        self._stores_less = False  # whether the next pass need not store all blobs
        self._is_at_once = False  # whether backward runs directly after forward
        self._is_running = False  # whether a pass has begun and not ended
        # whether the steps fit the shapes; an interrupted reshape is repeated
        self._is_reshaped = False
        self._fits = False  # whether the check for memory has passed
        self._by_layer = False  # whether there is a step for each layer, so that a part can run
        # blobs of which neither memory nor a step has the values
        self._unknown: dict[Blob, Unknown] = {}
        self.steps: Sequence[Step] = []
        self._make_steps()
        self._seed_losses()
        if weights is not None:
            _, missing = self.copy_from(weights)
            if missing:
                log.warning(
                    "%s has no weights for %s; they keep their initial values",
                    weights,
                    ", ".join(missing),
                )

    # -------------------------------------------------------------------------------------- running

    def forward(
        self,
        blobs: Iterable[str] | None = None,
        start: str | None = None,
        end: str | None = None,
        **inputs: Any,
    ) -> dict[str, NDArray[Any]]:
        """Run the layers from ``start`` to ``end`` (inclusive; default all) and return the tops
        of the last one.

        For the whole net these are its outputs. ``inputs`` are arrays for the input blobs; a new
        shape reshapes the net. ``blobs`` names more blobs to return.
        """
        part = self._part(start, end)
        with self.one_thread:  # inputs are shared: a second thread would overwrite them
            self._set_inputs(
                {name: _numbers(array, f"input {name!r}") for name, array in inputs.items()}
            )
            self._forward_steps(*part)
        names = self.outputs if end is None else self.layer_dict[end].spec.top
        return {name: self._blob(name).data for name in [*names, *(blobs or [])]}

    def run_forward(self, first: int = 0, last: int | None = None) -> float:
        """Run the layers numbered ``first`` up to but not including ``last``, by default all, and
        return their loss.
        """
        self._forward_steps(first, last)
        return self.loss(slice(first, last))

    def _forward_steps(self, first: int, last: int | None) -> None:
        with self._pass():
            if not self._is_reshaped:
                self.reshape()
            if (first, last) != (0, None):
                self._run_by_layer()
            elif self._stores_less and self._by_layer:
                self._by_layer = False
                self._make_steps()
            if not self._fits:
                check_memory(self.steps)
                self._fits = True
            for step in self.steps[first:last]:
                self._will_write("data", step)
                step.forward()
            if lost := [step for step in self.steps if step.lost]:
                for step in lost:
                    self._note(step.lost)
                    step.lost = {}
                self._use(self.steps)

    @contextmanager
    def _pass(self) -> Iterator[None]:
        """Context manager of a pass: in one thread; a blob that is not stored cannot be
        read meanwhile.
        """
        # the solver reports values that are not finite
        with self.one_thread, np.errstate(all="ignore"):
            before, self._is_running, self._writing = self._is_running, True, []
            try:
                yield
            except BaseException:
                for unknown, half in self._writing:  # the last step may not have written them
                    unknown.halves.add(half)
                raise
            finally:
                self._is_running = before

    def loss(self, layers: slice = slice(None)) -> float:
        """The loss of the last forward pass, or the part of it from some layers: the sum of
        loss_weight x top.
        """
        tops = {blob for at in self.connections[layers] for blob in at.top}
        losses = [(blob, weight) for blob, weight, _ in self.losses if blob in tops]
        return float(
            sum(weight * float(blob.data.sum(dtype=np.float64)) for blob, weight in losses)
        )

    def backward(
        self,
        diffs: Iterable[str] | None = None,
        start: str | None = None,
        end: str | None = None,
        **tops: Any,
    ) -> dict[str, NDArray[Any]]:
        """Run the layers backwards from ``start`` to ``end`` and return the diffs of the last
        one's bottoms.

        For the whole net these are its inputs. ``tops`` are arrays for the diffs of output blobs;
        ``diffs`` names more blobs whose diffs to return.
        """
        part = self._part(end, start)
        with self.one_thread:
            self._seed_losses()
            for name, array in tops.items():
                diff, given = self._blob(name).diff, _numbers(array, f"output {name!r}")
                try:
                    diff[...] = given
                except ValueError:
                    raise LayerError(
                        f"output {name!r} has shape {diff.shape}, got an array of shape {given.shape}"
                    ) from None
            self._backward_steps(*part)
        names = self.inputs if end is None else self.layer_dict[end].spec.bottom
        return {name: self._blob(name).diff for name in [*names, *(diffs or [])]}

    def run_backward(self, first: int = 0, last: int | None = None) -> None:
        """Run the layers numbered ``first`` up to but not including ``last`` backwards, adding to
        parameter diffs.
        """
        with self.one_thread:
            self._seed_losses()
            self._backward_steps(first, last)

    def run_forward_backward(self) -> float:
        """Run all layers forwards, then backwards, as an iteration of a solver does;
        returns the loss.

        No other code than that of the layers runs between the two, so nothing can be written there.
        """
        loss = self.run_forward()
        self._is_at_once = all(layer.type != "Python" for layer in self.layers)
        try:
            self.run_backward()
        finally:
            self._is_at_once = False
        return loss

    def _backward_steps(self, first: int, last: int | None) -> None:
        with self._pass():
            if not self._is_reshaped:
                self.reshape()
            if (first, last) != (0, None):
                self._run_by_layer()
            if not all(step.has_run() for step in self.steps[first:last]):
                self._run_missing(first, last)
            for step in reversed(self.steps[first:last]):
                self._will_write("diff", step)
                step.backward(self._is_at_once)

    def _run_missing(self, first: int, last: int | None) -> None:
        """Run forwards, once, the layers whose backward will run and that have not run with the
        current shapes. Blobs that another layer has read keep their data.

        Raises NetlibError if such a layer reads data or draws random numbers: this would change
        the next pass.
        """
        self.reshape()
        self._run_by_layer()
        missing = [step for step in self.steps[first:last] if not step.has_run()]
        layers = [step.connections[0].layer for step in missing]
        before = snapshot.as_plain({layer.name: layer.state() for layer in layers})
        read = {blob for at in self.connections if at.has_run() for blob in at.bottom}
        for layer, step in zip(layers, missing):
            if not layer.spec.bottom and not layer.is_input:
                raise layer.fail(
                    "backward was called before forward, which reads data: run forward first"
                )
            kept = [(blob, blob.data.copy()) for blob in step.connections[0].top if blob in read]
            self._will_write("data", step)
            step.forward()
            for blob, data in kept:  # before a later layer reads them
                blob.data[...] = data
            if snapshot.as_plain(layer.state()) != before[layer.name]:
                self.restore_layer_states(before)
                raise layer.fail(
                    "backward was called before forward, which draws random numbers: run forward first"
                )

    def _seed_losses(self) -> None:
        """Set the diff of each loss to its weight: the loss is the sum of loss_weight x top, so
        dL/dtop = loss_weight.

        As in Caffe, the weight is written once per array, so a value that the user writes over it
        is kept. If a layer in place overwrites it, it is written before each pass.
        """
        for i, (blob, weight, _) in enumerate(self.losses):
            diff, seeded = blob.diff, self._seeded.get(i)
            if seeded is None or not np.may_share_memory(seeded, diff) or blob in self._in_place:
                diff[...] = weight
                self._seeded[i] = diff

    def _part(self, first: str | None, last: str | None) -> tuple[int, int | None]:
        """Range of layer indices from ``first`` to ``last``."""
        if first is last is None:
            return 0, None
        names = list(self.layer_dict)
        for name in (first, last):
            if name is not None and name not in self.layer_dict:
                raise NetlibError(
                    f"net {self.name!r} has no layer {name!r}{did_you_mean(name, names)}"
                )
        return 0 if first is None else names.index(first), None if last is None else names.index(
            last
        ) + 1

    def _set_inputs(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write the input blobs; reshape the net once if any shape is new."""
        reshaped = False
        for name, array in arrays.items():
            if name not in self.inputs:
                raise NetlibError(
                    f"net {self.name!r} has no input {name!r}{did_you_mean(name, self.inputs)}; "
                    f"its inputs: {', '.join(self.inputs) or 'none'}"
                )
            blob = self.blobs[name]
            if array.ndim != len(blob.shape):
                raise LayerError(
                    f"input {name!r} has shape {blob.shape}, got an array of shape {array.shape}"
                )
            if array.shape != blob.shape:
                self._is_reshaped = False
                blob.reshape(array.shape)
                reshaped = True
        if reshaped:
            self.reshape()
        for name, array in arrays.items():
            self.engine.copy(array, self.blobs[name].data)

    def _blob(self, name: str | None) -> Blob:
        if name not in self.blobs:
            raise NetlibError(
                f"net {self.name!r} has no blob {name!r}{did_you_mean(str(name), self.blobs)}"
            )
        return self.blobs[str(name)]

    def reshape(self) -> None:
        """Reshape all blobs after an input blob was reshaped."""
        with self._pass():
            self._is_reshaped = self._fits = False
            for at in self.connections:
                with at.errors:
                    at.layer.reshape(at.bottom, at.top)
                if not at.has_run():
                    at.ran_with = None
            self._make_steps()
            self._seed_losses()

    # ---------------------------------------------------------------------------------------- steps

    def _make_steps(self) -> None:
        """Make the steps for the current shapes, unless there is one for each layer already."""
        if not self._by_layer:
            old, new = self.steps, self.engine.steps(self.connections, self._outside, self.steps)
            for step in old:
                if step not in new:  # values of the last pass that keep their shape are not lost
                    self._note(step.store())
            self._use(new)
        self._is_reshaped = True

    def _run_by_layer(self) -> None:
        """From now on run a step for each layer, which stores all blobs, with the values of
        the last pass.
        """
        if self._by_layer:
            return
        self._is_reshaped = False  # until all is done
        by_layer = self.engine.steps_by_layer(self.connections)
        with np.errstate(all="ignore"):
            for step in self.steps:
                self._note(step.store())
        self._use(by_layer)
        self._by_layer = self._is_reshaped = True

    def _use(self, steps: Sequence[Step]) -> None:
        """Run these steps from now on.

        At any time the blobs that the old or the new ones do not store are watched.
        """
        access = partial(_store, weakref.ref(self))
        unstored = {blob for step in steps for blob in step.unstored}
        for blob in unstored:
            blob.on_access = access
        self.steps = steps
        for blob in self.blobs.values():
            if blob not in unstored:
                blob.on_access = self._unknown.get(blob)

    def store_all(self, wanted: bool = True) -> None:
        """Store every blob from now on, as after the first access to one that is not stored; or
        only the needed ones from the next full pass on.

        Results differ in rounding. A solver state has which it was, so that a resume is exact.
        """
        with self.one_thread:
            if wanted:
                self._run_by_layer()
            self._stores_less = not wanted

    @property
    def stores_all(self) -> bool:
        """Whether every blob is stored, because a caller has accessed one that was not, or
        has run a part.
        """
        return self._by_layer and not self._stores_less

    def _note(self, missing: Missing) -> None:
        """Note the values that a step could not compute."""
        names = {blob: name for name, blob in self.blobs.items()}
        self._unknown |= {
            blob: Unknown(names[blob], set(halves)) for blob, halves in missing.items()
        }

    def _will_write(self, half: str, step: Step) -> None:
        """Note that a step writes this half of its blobs, unless it also reads them."""
        if not self._unknown:
            return
        self._writing = []
        for at in step.connections:
            written, read = (at.top, at.bottom) if half == "data" else (at.bottom, at.top)
            for blob in written:
                unknown = self._unknown.get(blob)
                if unknown and half in unknown.halves and blob not in read:
                    unknown.halves.discard(half)
                    self._writing.append((unknown, half))

    def clear_param_diffs(self) -> None:
        """Set the gradients of all parameters to zero."""
        self.engine.run(
            [partial(param.blob.diff.fill, 0) for param in self.learnable], self._learnable_values
        )

    def first_not_finite(self) -> str | None:
        """Describe where in the net NaN or infinity first appears; None if all
        values are finite.
        """
        for at in self.connections:
            for i, param in enumerate(at.layer.blobs):
                if not np.isfinite(param.data).all():
                    return f"parameter {i} of layer {at.layer.name!r}"
            for name, blob in zip(at.layer.spec.top, at.top):
                if not np.isfinite(blob.data).all():
                    return f"top blob {name!r} of layer {at.layer.name!r}"
        return None

    def __reduce_ex__(self, protocol: Any) -> Any:
        raise NetlibError(
            "a net cannot be copied or pickled; build a second net from the same file and copy the "
            "weights with copy_from, or save them"
        )

    # --------------------------------------------------------------------------- weights and states

    def copy_from(
        self, source: str | Path | Content | Net, strict: bool = False
    ) -> tuple[list[str], list[str]]:
        """Copy weights by layer name from a snapshot, from its content, or from another net.

        Returns the names of the layers that only the source has, and of those that only this net
        has, which keep their values. Raises WeightsError if a shape differs, if no layer matches,
        or, with ``strict``, if the source lacks a layer of this net.
        """
        return weights_of.copy(self, source, strict)

    def share_params(self, other: Net) -> None:
        """Share the other net's parameters, by layer name, as a test net shares those of
        the training net.

        As in Caffe, each net keeps its own gradients. Raises LayerError if shapes or dtypes differ.
        """
        weights_of.share(self, other)

    def save(self, path: str | Path) -> None:
        """Write the weights atomically, in Caffe's HDF5 format if the name ends in ``.h5``, else in
        binary format.
        """
        snapshot.write_weights(weights_of.image(self, path), path)

    def layer_states(self) -> dict[str, Any]:
        """Return the state of every layer by name, for an exact resume."""
        return {layer.name: layer.state() for layer in self.layers}

    def restore_layer_states(self, states: Mapping[str, Any]) -> None:
        """Restore states that ``layer_states`` returned."""
        for name, state in states.items():
            if name in self.layer_dict:
                self.layer_dict[name].restore(state)


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


class Unknown:
    """Called at each access to a blob of which neither memory nor a step has the values:
    raises NetlibError.

    halves  "data" and "diff", those of them that are unknown
    """

    def __init__(self, name: str, halves: set[str]) -> None:
        self.name, self.halves = name, halves

    def __call__(self, blob: Blob, half: str) -> None:
        """Raise NetlibError if this half of the blob is unknown."""
        if half not in self.halves:
            return
        if half == "data":
            raise NetlibError(
                f"the data of blob {self.name!r} is unknown: the last pass did not complete; "
                "run forward again"
            )
        raise NetlibError(
            f"the diff of blob {self.name!r} is unknown: it was not stored, and its backward pass did "
            "not complete or a forward pass came after it; read it directly after backward"
        )


def _store(net: weakref.ref[Net], blob: Blob, half: str) -> None:
    """Store all blobs of a net before the first access to one that it did not store.

    Raises NetlibError.
    """
    owner = net()
    if owner is None:
        raise NetlibError(
            "this blob was not stored and its net is gone; read it, or copy it, before"
        )
    with owner.one_thread:
        if owner._is_running:
            raise NetlibError(
                f"net {owner.name!r}: a blob that is not stored is read during a pass; read it once "
                "before, so that the net stores all blobs"
            )
        owner.store_all()
        owner._use(owner.steps)  # again, if it was interrupted
    if blob.on_access is not None:
        blob.on_access(blob, half)


def _numbers(array: Any, what: str) -> NDArray[Any]:
    """Convert to an array of numbers.

    Raises LayerError for other types, ragged lists and masked arrays.
    """
    if isinstance(array, np.ma.MaskedArray):
        raise LayerError(
            f"{what} got a masked array; expected a plain one, for example array.filled(VALUE)"
        )
    try:
        found = np.asarray(array)
    except ValueError:
        raise LayerError(f"{what} got rows of different lengths; expected one array") from None
    if found.dtype.kind not in "fiub":
        raise LayerError(f"{what} got an array of {found.dtype}; expected numbers")
    return found
