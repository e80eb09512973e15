"""Run layers slice by slice: a few images at a time, one slice per thread.

The first convolution of the paper's network writes 252 MB for a batch of 512, and every layer that touches
such a blob pays for main memory. So the net runs a row of *batchwise* layers (item n of a top depends only on
item n of the bottoms) on one slice of the batch after the other: a slice's blobs stay in the processor's cache.

Each slice has copies of the layers, with the same parameter values and with little blobs of their own:

- a blob that only this run reads and writes is *hidden*: its values live in the working memory of the thread,
  or with the slice if backward needs them again; the whole blob never exists;
- any other blob is a window on the whole one.

Slices are dealt to a fixed number of *lanes*. A lane's slices share parameter gradients and run one after the other;
a thread takes the next lane when it is free; the lanes are summed in order. So results do not depend on the number
of threads.

    batch   0..16 | 17..33 | 34..50 | ...       slices, one piece (copies of the layers) each
    lane    0     | 1      | 2      | ...  15 | 0 | 1 ...
    dw = dw(lane 0) + dw(lane 1) + ...          always in this order

``net.blobs[name].data`` is true all the same. When somebody first looks at a hidden blob, it is stored from then on,
and what the last pass put there is computed again, as long as the inputs of that pass have not been overwritten and,
for a diff, until the next forward. Who looks at two of them is going to look at all: then none is hidden any more, and
looking through all blobs of a net costs no more than two passes.
"""

from __future__ import annotations

import copy
import threading
import weakref
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from fast import parallel
from fast.facts import facts_of
from fast.plan import Run, plan, whole
from fast.tiles import FastBlob, LazilyCleared
from fast.twin import Twin
from netlib.blob import Array, Blob, Blobs
from netlib.errors import NetlibError
from netlib.layer import Layer
from netlib.plain import Connection, Executor, Step, guarded

# Aim for the largest blob of a slice; less is more calls, and threads wait for each other in calls.
SLICE_BYTES = 16 << 20
LARGEST_SLICE = 64
LANES = 16

Piece = list[Connection]  # the layers of a run, for one slice
Lane = list[Piece]  # slices that share parameter gradients


class SlicedExecutor(Executor):
    """Runs a net in slices where that pays, and layer by layer as soon as somebody asks for a part of it."""

    steps: Sequence[WholeStep | SlicedStep]

    def __init__(self, connections: Sequence[Connection], outside: Iterable[Blob]) -> None:
        self.connections = list(connections)
        for at in self.connections:
            if isinstance(at.layer, Twin):
                at.layer.needs_backward, at.layer.needs_bottom_diff = at.needs_backward, any(at.propagate_down)
        self._stored = {id(blob) for blob in outside}
        self._looked = False
        self._by_layer = False
        self._seen = [False, False]  # has forward, has backward run
        self._plan()

    def _plan(self) -> None:
        """Decide what runs in slices, and watch the blobs that are hidden by it."""
        for at in self.connections:
            for blob in at.top:
                if isinstance(blob, FastBlob):
                    blob.on_look = None
        runs = [whole(at) for at in self.connections]
        if not self._by_layer:
            runs = plan(self.connections, lambda blob: id(blob) in self._stored)
        self.steps = [SlicedStep(run) if run.sliced else WholeStep(run.connections[0]) for run in runs]
        for blob in self.hidden():
            assert isinstance(blob, FastBlob)
            blob.on_look = partial(_look, weakref.ref(self), blob)

    def hidden(self) -> list[Blob]:
        """Blobs that do not exist for the whole batch."""
        return [blob for step in self.steps if isinstance(step, SlicedStep) for blob in step.run.hidden]

    def forward(self, first: int = 0, last: int | None = None) -> None:
        """Run layers ``first`` to before ``last`` forwards."""
        if self._is_part(first, last):
            self._run_by_layer()
        super().forward(first, last)
        if not self._is_part(first, last):
            self._seen = [True, False]

    def backward(self, first: int = 0, last: int | None = None) -> None:
        """Run layers ``first`` to before ``last`` backwards."""
        if self._is_part(first, last):
            self._run_by_layer()
        super().backward(first, last)
        if not self._is_part(first, last):
            self._seen[1] = True

    def reshape(self) -> None:
        """Shape all blobs anew; where no shape has changed, all stays as it is."""
        before = [blob.shape for at in self.connections for blob in [*at.bottom, *at.top]]
        super().reshape()
        if before != [blob.shape for at in self.connections for blob in [*at.bottom, *at.top]]:
            self._seen = [False, False]
            self._plan()

    def clear_diffs(self, params: Iterable[Blob]) -> None:
        """Set gradients of parameters to zero, or see to it that they read as zeros."""
        for param in params:
            if isinstance(param, LazilyCleared):
                param.clear()
            else:
                param.diff.fill(0)

    @staticmethod
    def _is_part(first: int, last: int | None) -> bool:
        return (first, last) != (0, None)

    def _run_by_layer(self) -> None:
        """A net that is run in parts runs layer by layer from then on: indices of steps are those of layers."""
        if not self._by_layer:
            self._by_layer = True
            self._replan()

    # ------------------------------------------------------------------------------------------ looking

    def reveal(self, blob: Blob) -> None:
        """Somebody looks at a hidden blob: store it from now on, with what the last pass put there."""
        self._stored |= {id(b) for b in self.hidden()} if self._looked else {id(blob)}
        self._looked = True
        self._replan()

    def _replan(self) -> None:
        """Plan anew, and let the new steps know what the old ones knew: values, winners, masks."""
        old = [step for step in self.steps if isinstance(step, SlicedStep)]
        self._plan()
        for step in old:
            self._repeat(step)

    def _repeat(self, old: SlicedStep) -> None:
        """Compute again what ``old`` computed in the last pass; whatever others can see stays as it is."""
        inside = {id(at) for at in old.run.connections}
        steps = [step for step in self.steps if id(step.at) in inside]
        params = [p for at in old.run.connections for p in at.layer.blobs]
        now = [(p.data, p.data.copy()) for p in params]
        _put_back(old.weights)
        if self._seen[0]:
            kept = [(b.data, b.data.copy()) for b in old.run.outside("top")]
            for step in steps:
                step.forward()
            _put_back(kept)
        if self._seen[1]:
            kept = [(b.diff, b.diff.copy()) for b in [*old.run.outside("bottom"), *params]]
            for step in reversed(steps):
                step.backward()
            _put_back(kept)
        _put_back(now)


def _look(executor: weakref.ref[SlicedExecutor], blob: Blob) -> None:
    """Tell the executor that somebody looks at a hidden blob."""
    owner = executor()
    if owner is None:
        raise NetlibError("this blob was computed in slices and its net is gone; look at it, or copy it, before")
    owner.reveal(blob)


def _put_back(kept: list[tuple[Array, Array]]) -> None:
    for array, values in kept:
        array[...] = values


class WholeStep(Step):
    """One layer, run on the whole batch. Our own layers need a reshape only where a shape has changed."""

    def __init__(self, at: Connection) -> None:
        super().__init__(at)
        self._steady = at.layer.type != "Python"  # a Python layer may do what it likes
        self._shapes: list[tuple[int, ...]] | None = None

    def forward(self) -> None:
        """Shape the tops and compute them."""
        shapes = [blob.shape for blob in self.at.bottom]
        if shapes != self._shapes or not self._steady:
            guarded(self.at.layer, "reshape", self.at.bottom, self.at.top)
            self._shapes = shapes
        guarded(self.at.layer, "forward", self.at.bottom, self.at.top)


class SlicedStep(Step):
    """Several layers in a row, run slice by slice."""

    def __init__(self, run: Run) -> None:
        super().__init__(run.connections[0])
        self.run = run
        self._needs_backward = any(at.needs_backward for at in run.connections)
        self._kept = {id(b) for at in run.order for b in _read_again(at)}
        self._buffers = threading.local()
        self._shapes: list[tuple[int, ...]] = []
        self._lanes: list[Lane] = []
        self.weights: list[tuple[Array, Array]] = []  # parameters, and their values in the last forward
        self._inputs, self._outputs = run.outside("bottom"), run.outside("top")
        down = {id(b) for at in run.connections for b, wanted in zip(at.bottom, at.propagate_down) if wanted}
        self._gradients = [b for b in self._inputs if id(b) in down] + self._outputs  # whose diff is written or read

    def pieces(self) -> list[Piece]:
        """The layers for every slice, in the order in which they run."""
        self._reshape()
        return [piece for lane in self._lanes for piece in lane]

    def forward(self) -> None:
        """Run the layers forwards on all slices."""
        self._reshape()
        self.weights = [(p.data, p.data.copy()) for at in self.run.connections for p in at.layer.blobs]
        for blob in self._outputs:
            _ensure(blob, "data")  # memory is taken here, not by several threads at once
        parallel.run([partial(self._forward, lane) for lane in self._lanes])

    def _forward(self, lane: Lane) -> None:
        for piece in lane:
            for at in piece:
                guarded(at.layer, "forward", at.bottom, at.top)

    def backward(self) -> None:
        """Run the layers backwards on all slices, and add up the gradients of the parameters."""
        if not self._needs_backward:
            return
        for blob in self._gradients:
            _ensure(blob, "diff")
        parallel.run([partial(self._backward, lane) for lane in self._lanes])
        for i, at in enumerate(self.run.order):
            for j, param in enumerate(at.layer.blobs):
                for lane in self._lanes:
                    param.diff[...] += lane[0][i].layer.blobs[j].diff

    def _backward(self, lane: Lane) -> None:
        for at in lane[0]:
            for param in at.layer.blobs:
                param.diff[...] = 0
        for piece in lane:
            for at in reversed(piece):
                if at.needs_backward:
                    guarded(at.layer, "backward", at.top, at.propagate_down, at.bottom)

    def _reshape(self) -> None:
        """Cut the batch into slices, if that is not done yet for these shapes."""
        shapes = [b.shape for b in self._inputs]
        if shapes == self._shapes and self._lanes:
            return
        for at in self.run.connections:
            guarded(at.layer, "reshape", at.bottom, at.top)
        items = self.at.bottom[0].shape[0]
        largest = max(b.count * b.dtype.itemsize // max(items, 1) for at in self.run.connections for b in at.top)
        lanes: list[Lane] = []
        for i, rows in enumerate(parallel.blocks(items, _slice_size(largest))):
            if i < LANES:
                params = [Blobs([_ParamOfLane(p) for p in at.layer.blobs]) for at in self.run.order]
                lanes.append([])
            else:
                params = [at.layer.blobs for at in lanes[i % LANES][0]]
            lanes[i % LANES].append(self._piece(rows, params))
        self._lanes, self._shapes = lanes, shapes

    def _piece(self, rows: slice, params: list[Blobs]) -> Piece:
        """The layers for one slice."""
        blobs: dict[int, Blob] = {}

        def on_slice(whole: Blob) -> Blob:
            if id(whole) not in blobs:
                blobs[id(whole)] = self._slice_blob(whole, rows)
            return blobs[id(whole)]

        piece = []
        for at, own_params in zip(self.run.order, params):
            bottom, top = Blobs(map(on_slice, at.bottom)), Blobs(map(on_slice, at.top))
            layer = _with_params(at.layer, own_params)
            guarded(layer, "reshape", bottom, top)
            piece.append(Connection(layer, bottom, top, at.propagate_down, at.needs_backward))
        return piece

    def _slice_blob(self, whole: Blob, rows: slice) -> Blob:
        shape = (rows.stop - rows.start, *whole.shape[1:])
        if all(whole is not b for b in self.run.hidden):
            return _Window(whole, rows, shape)
        blob = _Hidden(shape, whole.dtype, self._buffers, id(whole), id(whole) in self._kept)
        blob.tile = self.run.tiles.get(id(whole))
        users = [at.layer for at in self.run.order if any(b is whole for b in [*at.bottom, *at.top])]
        can = all(isinstance(layer, Twin) and layer.sparse_tiles() for layer in users)
        blob.may_be_sparse = blob.tile is not None and len(users) == 2 and can
        return blob


def _with_params(layer: Layer, params: Blobs) -> Layer:
    """The layer for one slice of a batch: same options, parameters with diffs of their own."""
    other = copy.copy(layer)
    other.blobs = params
    return other


def _ensure(blob: Blob, half: str) -> None:
    """Take the memory of ``data`` or ``diff`` now."""
    getattr(blob, half)


def _slice_size(item_bytes: int) -> int:
    """Items per slice: a power of two, so that products divide into equal parts; 32 images of the hand network."""
    wanted = max(1, min(LARGEST_SLICE, SLICE_BYTES // max(item_bytes, 1)))
    return 1 << (wanted.bit_length() - 1)


class _Window(Blob):
    """Some items of a whole blob."""

    def __init__(self, whole: Blob, rows: slice, shape: tuple[int, ...]) -> None:
        super().__init__(shape, whole.dtype)
        self._whole, self._rows = whole, rows

    @property
    def data(self) -> Array:
        return self._whole.data[self._rows]

    @property
    def diff(self) -> Array:
        return self._whole.diff[self._rows]


class _Hidden(FastBlob):
    """A blob of one slice. Its diff, and its data unless kept, are only good until the thread's next slice."""

    def __init__(self, shape: tuple[int, ...], dtype: Any, buffers: threading.local, key: int, keep: bool) -> None:
        super().__init__(shape, dtype)
        self._buffers, self._key, self._keep = buffers, key, keep

    @property
    def data(self) -> Array:
        if self._keep:
            if self._data is None:
                self._data = np.zeros(self.storage_shape, self.dtype)
            return self._data
        return self._buffer("data")

    @property
    def diff(self) -> Array:
        return self._buffer("diff")

    def _buffer(self, half: str) -> Array:
        return parallel.buffer_of(self._buffers, f"{half}{self._key}", self.storage_shape, self.dtype)


class _ParamOfLane(Blob):
    """A parameter with the values of another and a diff of its own."""

    def __init__(self, original: Blob) -> None:
        super().__init__(original.shape, original.dtype)
        self._original = original

    @property
    def data(self) -> Array:
        return self._original.data


def _read_again(at: Connection) -> list[Blob]:
    """The blobs whose data a layer's backward reads."""
    if not at.needs_backward:
        return []
    facts = facts_of(at.layer)
    return [*(at.bottom if facts.reads_bottom else []), *(at.top if facts.reads_top else [])]
