"""What the last pass of some layers read, so that blobs which it did not store can be
computed at any time.

A run in slices (slices.py) does not store all blobs. ``LastPass`` copies what determines the values
of the others: the blobs that the run reads, the parameters, and for the gradients also the diffs of
its tops. A caller may therefore write or reshape any blob, and the solver may update the weights,
before the first access to an unstored blob.

The copies are complete. The values of a few places do not show whether a caller has written others.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from fast.fast_layer import FastLayer
from fast.fusing import release
from fast.parallel import zeros_for_blob
from fast.plan import Run, uses_of
from netlib.blob import Array, Blob, Blobs, blocks
from netlib.engine import Connection, Missing
from netlib.layer import Layer

BLOCK = 1 << 18  # words compared at a time, so that the result of a comparison stays in the cache
DATA, DIFF = frozenset({"data"}), frozenset({"diff"})
Copies = dict[Blob, Array]


@dataclass
class Backward:
    """What the last backward of a pass read.

    weights    values of the parameters
    tops       data of the stored blobs that the run writes, if it reads them again
    top_diffs  diffs of the stored blobs that the run writes
    is_done    whether the backward pass is complete
    """

    weights: list[Array]
    tops: Copies
    top_diffs: Copies
    is_done: bool = False


@dataclass
class LastPass:
    """The last pass of a run.

    run      the layers, with the blobs of the net
    inputs   data of the blobs that the run reads
    weights  values of the parameters
    shapes   shapes of all blobs
    is_done  whether the forward pass is complete; None: none has begun
    back     the last backward of this pass, if any
    stale    the unstored blobs whose diffs are of an earlier pass
    """

    run: Run
    inputs: Copies = field(default_factory=dict)
    weights: list[Array] = field(default_factory=list)
    shapes: dict[Blob, tuple[int, ...]] = field(default_factory=dict)
    is_done: bool | None = None
    back: Backward | None = None
    stale: frozenset[Blob] = frozenset()

    def __post_init__(self) -> None:
        uses, written = uses_of(self.run.order), set(self.run.written())
        again = self.run.read_again()
        self._read = [blob for blob in dict.fromkeys(self.run.read()) if uses[blob][0].reads]
        self._unwritten = [blob for blob in self._read if blob not in written]
        self._tops = [blob for blob in written if blob in again]
        self._params = [param for at in self.run.connections for param in at.layer.blobs]
        self._differentiated = frozenset(self.run.differentiated().intersection(self.run.unstored))
        self._buffers: tuple[Copies, Copies] = {}, {}

    # ------------------------------------------------------------------------------------ recording

    def take(self, values: Copies) -> None:
        """Take a complete forward pass, of blobs with ``shapes``, that read these values."""
        self.inputs = {blob: values[blob].reshape(self.shapes[blob]) for blob in self._read}
        self.weights = [values[param] for param in self._params]
        self.finish()

    def begin(self) -> None:
        """Prepare the copies of a forward pass, and copy the parameters."""
        stale = self.stale if self.back is None else self._differentiated
        # a reshape to another count discards diffs
        self.stale = frozenset(blob for blob in stale if blob.count == math.prod(self.shapes[blob]))
        self.is_done, self.back = False, None
        self.shapes = {blob: blob.shape for at in self.run.connections for blob in at.blobs}
        self.inputs = _like(self._read, self.inputs)
        if [param.shape for param in self._params] != [values.shape for values in self.weights]:
            self.weights = [np.empty_like(param.data) for param in self._params]
        for param, values in zip(self._params, self.weights):
            values[...] = param.data

    def finish(self) -> None:
        """Note that the forward pass is complete."""
        self.is_done = True

    def copy_inputs(self, rows: slice) -> None:
        """Copy the items ``rows`` of the inputs, before the layers run."""
        for blob, values in self.inputs.items():
            values[rows] = blob.data[rows]

    def begin_backward(self, at_once: bool) -> None:
        """Prepare the copies of a backward pass; the parameters are copied if they have changed
        since forward, which they cannot have if backward runs ``at_once``.
        """
        tops = _like(self._tops, self._buffers[0])
        top_diffs = _like(self.run.written(), self._buffers[1])
        self._buffers = tops, top_diffs
        weights = self.weights
        if not at_once:
            weights = [
                values if is_same(param.data, values) else param.data.copy()
                for param, values in zip(self._params, weights)
            ]
        self.back = Backward(weights, tops, top_diffs)

    def copy_top_diffs(self, rows: slice) -> None:
        """Copy the items ``rows`` of what backward reads, before the layers run."""
        assert self.back is not None
        for blob, values in self.back.tops.items():
            values[rows] = blob.data[rows]
        for blob, values in self.back.top_diffs.items():
            values[rows] = blob.diff[rows]

    def written_input(self, rows: slice) -> Blob | None:
        """An input of which a caller has written the items ``rows`` since forward, if any."""
        changed = (
            blob
            for blob in self._unwritten
            if not is_same(blob.data[rows], self.inputs[blob][rows])
        )
        return next(changed, None)

    def finish_backward(self) -> None:
        """Note that the backward pass is complete."""
        assert self.back is not None
        self.back.is_done, self.stale = True, frozenset()

    # ------------------------------------------------------------------------------------ computing

    def store(self) -> Missing:
        """Store the unstored blobs, with the values of the pass, and let the layers keep what their
        backward reads.

        A blob that has another number of values now keeps none, as after any reshape. Not
        computable: the blobs of an incomplete pass, and diffs of an earlier one.
        """
        if self.is_done is None:
            return Missing({})
        if self.is_discarded():
            return Missing({}, self.run.connections)
        stale = self.stale if self.back is None or self.back.is_done else self._differentiated
        if self.is_done:
            self._store()
            return Missing(dict.fromkeys(stale, DIFF))
        halves = {blob: DATA | DIFF if blob in stale else DATA for blob in self.run.unstored}
        return Missing(halves, self.run.connections)

    def _store(self) -> None:
        """Repeat the pass with copies of the layers, and keep what it gives."""
        blobs = {
            blob: Blob(shape, blob.dtype, zeros_for_blob) for blob, shape in self.shapes.items()
        }
        connections = [_copied(at, blobs) for at in self.run.connections]
        self._compute(connections, blobs)
        diffs = self._differentiated if self.back is not None and self.back.is_done else ()
        for blob in self.run.unstored:
            blob.keep(data=blobs[blob].data)
            if blob in diffs:
                blob.keep(diff=blobs[blob].diff)
        for at, computed in zip(self.run.connections, connections):
            _take_state(at.layer, computed.layer)

    def is_discarded(self) -> bool:
        """Whether reshapes since the pass have discarded all blobs, and what the layers keep."""
        changed = [blob.count != math.prod(shape) for blob, shape in self.shapes.items()]
        return bool(changed) and all(changed)

    def _compute(self, connections: list[Connection], blobs: Mapping[Blob, Blob]) -> None:
        """Run these copies of the layers forwards, and backwards if the pass was."""
        params = [param for at in connections for param in at.layer.blobs]
        _set(params, self.weights)
        for blob, values in self.inputs.items():
            blobs[blob].data[...] = values
        for at in connections:
            with at.errors:
                at.layer.reshape(at.bottom, at.top)
                at.layer.forward(at.bottom, at.top)
        if self.back is None or not self.back.is_done:
            return
        _set(params, self.back.weights)
        for blob, values in self.back.tops.items():
            blobs[blob].data[...] = values
        for blob, values in self.back.top_diffs.items():
            blobs[blob].diff[...] = values
        for at in reversed(connections):
            if at.needs_backward:
                with at.errors:
                    at.layer.backward(at.top, at.propagate_down, at.bottom)


def is_same(a: Array, b: Array) -> bool:
    """Whether two contiguous arrays of one shape and type have the same bits: NaN is
    NaN, 0 is not -0.
    """
    words = np.uint64 if a.nbytes % 8 == 0 else np.uint32
    own, other = a.reshape(-1).view(words), b.reshape(-1).view(words)
    return all(np.array_equal(own[part], other[part]) for part in blocks(len(own), BLOCK))


def with_params(layer: Layer, params: Blobs) -> Layer:
    """Copy a layer, with the same options and the given parameters."""
    other = copy.copy(layer)
    other.blobs = params
    if isinstance(other, FastLayer):
        other.forget()
    of_layer = {id(param): own for param, own in zip(layer.blobs, params)}
    for name, value in vars(layer).items():  # self.weight, self.bias
        if id(value) in of_layer:
            setattr(other, name, of_layer[id(value)])
    return other


def _copied(at: Connection, blobs: Mapping[Blob, Blob]) -> Connection:
    """A copy of a layer, which is computed on its own, with copies of its blobs and of
    its parameters.
    """
    layer = with_params(at.layer, Blobs(Blob(param.shape, param.dtype) for param in at.layer.blobs))
    bottom, top = (Blobs(blobs[blob] for blob in side) for side in (at.bottom, at.top))
    copied = Connection(layer, bottom, top, at.propagate_down, at.needs_backward)
    release([copied])
    return copied


def _take_state(layer: Layer, copied: Layer) -> None:
    """Give a layer what its copy keeps for backward."""
    params = {id(param) for param in copied.blobs}
    for name, value in vars(copied).items():
        if name not in ("blobs", "after", "is_fused") and id(value) not in params:
            setattr(layer, name, value)


def _like(blobs: Iterable[Blob], arrays: Copies) -> Copies:
    """An array for each blob, with its shape; those of ``arrays`` if they fit."""
    found: Copies = {}
    for blob in blobs:
        array = arrays.get(blob)
        found[blob] = (
            np.empty(blob.shape, blob.dtype)
            if array is None or array.shape != blob.shape
            else array
        )
    return found


def _set(params: Iterable[Blob], values: Iterable[Array]) -> None:
    for param, array in zip(params, values):
        param.reshape(array.shape)
        param.data[...] = array
