"""Run layers slice by slice: a few images at a time, one slice a thread.

The first convolution of the paper's network writes 252 MB for a batch of 512, and every layer that touches
such a blob pays for main memory. So the net runs a row of *batchwise* layers (item n of a top depends only on
item n of the bottoms) on one slice of the batch after the other: a slice's blobs stay in the processor's cache.

The layers know nothing of it. Each slice has twins of the layers, with the same parameter values and with
little blobs of their own:

- a blob that only this run reads and writes is *hidden*: its values live in the working memory of the thread,
  or with the slice if backward needs them again; the whole blob never exists;
- any other blob is a window on the whole one.

Slices are dealt to a fixed number of *lanes*; a lane's twins add their parameter gradients in the order of its
slices, and the lanes are summed in order. So results do not depend on the number of threads.

Two freedoms are used, both exact. A hidden blob between two layers that agree on it is *tiled* (see blob.py). And
a monotone layer in place (ReLU) before a max pooling runs after it, on a sixteenth of the values: max(f(a), f(b))
= f(max(a, b)), and the gradient takes the same way.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from netlib import parallel
from netlib.blob import Array, Blob, Blobs
from netlib.layer import Layer

SLICE_BYTES = 8 << 20  # aim for the largest blob of a slice: about the cache that one core can call its own
LARGEST_SLICE = 64
LANES = 16


@dataclass
class Connection:
    """A layer of a net with the blobs that it reads and writes."""

    layer: Layer
    bottom: Blobs
    top: Blobs
    propagate_down: list[bool]
    needs_backward: bool = False


class WholeStep:
    """One layer, run on the whole batch."""

    def __init__(self, at: Connection) -> None:
        self.connections = [at]
        self.hidden: list[Blob] = []
        self._shapes: list[tuple[int, ...]] | None = None

    def forward(self) -> None:
        """Shape the tops and compute them."""
        at = self.connections[0]
        shapes = [blob.shape for blob in at.bottom]
        if shapes != self._shapes or not at.layer.steady:
            at.layer.reshape(at.bottom, at.top)
            self._shapes = shapes
        at.layer.forward(at.bottom, at.top)

    def pieces(self) -> list[list[Connection]]:
        """The layer, for the whole batch."""
        return [self.connections]

    def backward(self) -> None:
        """Compute the diffs, if somebody needs them."""
        at = self.connections[0]
        if at.needs_backward:
            at.layer.backward(at.top, at.propagate_down, at.bottom)


class SlicedRun:
    """Several layers in a row, run slice by slice."""

    def __init__(self, connections: Sequence[Connection], hidden: list[Blob]) -> None:
        self.connections = list(connections)
        self.hidden = hidden
        self.needs_backward = any(at.needs_backward for at in connections)
        self._order = _pool_first(self.connections, hidden)
        self._tiles = _agree_on_tiles(self._order, hidden)
        self._kept = {id(b) for at in self._order for b in _read_again(at)}
        self._buffers = threading.local()
        self._shapes: list[tuple[int, ...]] = []
        self._lanes: list[list[list[Connection]]] = []
        self.weights: list[tuple[Array, Array]] = []  # parameters, and their values in the last forward
        self._inputs, self._outputs = self.outside("bottom"), self.outside("top")

    def outside(self, blobs: str) -> list[Blob]:
        """The whole blobs that the run reads (``"bottom"``) or writes (``"top"``)."""
        secret = {id(b) for b in self.hidden}
        return [b for at in self.connections for b in getattr(at, blobs) if id(b) not in secret]

    def pieces(self) -> list[list[Connection]]:
        """The twins of the layers for every slice, in the order in which they run."""
        self._reshape()
        return [piece for lane in self._lanes for piece in lane]

    def forward(self) -> None:
        """Run the layers forwards on all slices."""
        self._reshape()
        self.weights = [(p.data, p.data.copy()) for at in self.connections for p in at.layer.blobs]
        for blob in self._outputs:
            blob.ensure("data")  # memory is taken here, not by several threads at once
        parallel.run([self._forward_job(lane) for lane in self._lanes])

    def _forward_job(self, lane: list[list[Connection]]) -> Callable[[], None]:
        def job() -> None:
            for piece in lane:
                for at in piece:
                    at.layer.forward(at.bottom, at.top)

        return job

    def backward(self) -> None:
        """Run the layers backwards on all slices, and add up the gradients of the parameters."""
        if not self.needs_backward:
            return
        for blob in [*self._inputs, *self._outputs]:
            blob.ensure("diff")
        parallel.run([self._backward_job(lane) for lane in self._lanes])
        for i, at in enumerate(self._order):
            for j, whole in enumerate(at.layer.blobs):
                for lane in self._lanes:
                    whole.diff[...] += lane[0][i].layer.blobs[j].diff

    def _backward_job(self, lane: list[list[Connection]]) -> Callable[[], None]:
        def job() -> None:
            for at in lane[0]:
                for param in at.layer.blobs:
                    param.diff[...] = 0
            for piece in lane:
                for at in reversed(piece):
                    if at.needs_backward:
                        at.layer.backward(at.top, at.propagate_down, at.bottom)

        return job

    def _reshape(self) -> None:
        """Cut the batch into slices, if that is not done yet for these shapes."""
        shapes = [b.shape for b in self._inputs]
        if shapes == self._shapes and self._lanes:
            return
        for at in self.connections:
            at.layer.reshape(at.bottom, at.top)
        items = self.connections[0].bottom[0].shape[0]
        largest = max(b.count * b.dtype.itemsize // max(items, 1) for at in self.connections for b in at.top)
        slices = parallel.blocks(items, max(1, min(LARGEST_SLICE, SLICE_BYTES // max(largest, 1))))
        lanes: list[list[list[Connection]]] = []
        for i, rows in enumerate(slices):
            if i < LANES:
                params = [Blobs([_ParamTwin(p) for p in at.layer.blobs]) for at in self._order]
                lanes.append([])
            else:
                params = [at.layer.blobs for at in lanes[i % LANES][0]]
            lanes[i % LANES].append(self._piece(rows, params))
        self._lanes, self._shapes = lanes, shapes

    def _piece(self, rows: slice, params: list[Blobs]) -> list[Connection]:
        """The twins of the layers for one slice."""
        blobs: dict[int, Blob] = {}

        def on_slice(whole: Blob) -> Blob:
            if id(whole) not in blobs:
                blobs[id(whole)] = self._slice_blob(whole, rows)
            return blobs[id(whole)]

        piece = []
        for at, twin_params in zip(self._order, params):
            bottom, top = Blobs(map(on_slice, at.bottom)), Blobs(map(on_slice, at.top))
            layer = at.layer.on_slice(twin_params)
            layer.reshape(bottom, top)
            piece.append(Connection(layer, bottom, top, at.propagate_down, at.needs_backward))
        return piece

    def _slice_blob(self, whole: Blob, rows: slice) -> Blob:
        shape = (rows.stop - rows.start, *whole.shape[1:])
        if all(whole is not b for b in self.hidden):
            return _Window(whole, rows, shape)
        blob = _Hidden(shape, whole.dtype, self._buffers, id(whole), id(whole) in self._kept)
        blob.tile = self._tiles.get(id(whole))
        users = [at for at in self._order if any(b is whole for b in [*at.bottom, *at.top])]
        blob.may_be_sparse = blob.tile is not None and len(users) == 2 and all(at.layer.sparse_tiles() for at in users)
        return blob


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


class _Hidden(Blob):
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
        buffers, key, shape = self._buffers.__dict__, f"{half}{self._key}", self.storage_shape
        found: Array | None = buffers.get(key)
        if found is None or found.shape != shape:
            found = buffers[key] = np.zeros(shape, self.dtype)
        return found


class _ParamTwin(Blob):
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
    return [*(at.bottom if at.layer.reads_bottom else []), *(at.top if at.layer.reads_top else [])]


def _pool_first(connections: list[Connection], hidden: list[Blob]) -> list[Connection]:
    """Move a monotone layer, in place on a hidden blob, behind the max pooling that reads it to a hidden blob."""
    secret, order = {id(b) for b in hidden}, list(connections)
    for i in range(len(order) - 1):
        at, pool = order[i], order[i + 1]
        if (
            at.layer.monotone
            and at.bottom[0] is at.top[0]
            and id(at.top[0]) in secret
            and pool.layer.takes_maximum
            and pool.bottom[0] is at.top[0]
            and id(pool.top[0]) in secret  # else its diff would be seen with the layer's gradient in it
        ):
            moved = Connection(at.layer, Blobs(pool.top[:1]), Blobs(pool.top[:1]), at.propagate_down, at.needs_backward)
            order[i], order[i + 1] = pool, moved
    return order


def _agree_on_tiles(order: list[Connection], hidden: list[Blob]) -> dict[int, int]:
    """The tile of every hidden blob whose writer and readers can do with tiles."""
    tiles: dict[int, int] = {}
    for blob in reversed(hidden):  # readers first: what they want may depend on their own tops
        wishes: set[int | None] = set()
        for at in order:
            in_place = any(b is blob for b in at.bottom) and any(b is blob for b in at.top)
            if in_place:
                wishes |= set() if at.layer.elementwise else {None}
                continue
            top_tile = tiles.get(id(at.top[0])) if at.top else None
            wishes |= {at.layer.bottom_tile(i, top_tile) for i, b in enumerate(at.bottom) if b is blob}
            wishes |= {None for b in at.top if b is blob and not at.layer.writes_tiles()}
        if len(wishes) == 1 and (tile := wishes.pop()) is not None:
            tiles[id(blob)] = tile
    return tiles


def plan(connections: Sequence[Connection], whole: Callable[[Blob], bool]) -> list[WholeStep | SlicedRun]:
    """Arrange the layers of a net into steps. Blobs for which ``whole`` is true are never hidden."""
    steps: list[WholeStep | SlicedRun] = []
    row: list[Connection] = []
    for at in [*connections, None]:
        if at is not None and _fits(row, at):
            row.append(at)
            continue
        steps += _close(row, connections, whole)
        row = [at] if at is not None and _fits([], at) else []
        if at is not None and not row:
            steps.append(WholeStep(at))
    return steps


def _fits(row: list[Connection], at: Connection) -> bool:
    """May this layer join the row?"""
    if not at.layer.batchwise or not at.bottom:
        return False
    items = {b.shape[0] if b.shape else None for b in [*at.bottom, *at.top]}
    if len(items) != 1 or items == {None}:
        return False
    if not row:  # a first layer in place would change its own input, which could then not be read twice
        return all(b is not t for b in at.bottom for t in at.top)
    return row[0].bottom[0].shape[0] == at.bottom[0].shape[0]


def _close(row: list[Connection], every: Sequence[Connection], whole: Callable[[Blob], bool]) -> list[Any]:
    """The steps for a finished row."""
    while row:  # a layer in place on a blob that others read may run twice only if that changes nothing
        hidden = _hidden_blobs(row, every, whole)
        secret = {id(b) for b in hidden}
        odd = [
            i
            for i, at in enumerate(row)
            if not at.layer.monotone and any(b is t and id(t) not in secret for b in at.bottom for t in at.top)
        ]
        if not odd:
            break
        return _close(row[: odd[0]], every, whole) + [WholeStep(at) for at in row[odd[0] :]]
    if all(at.layer.elementwise for at in row):  # nothing to gain
        return [WholeStep(at) for at in row]
    return [SlicedRun(row, hidden)]


def _hidden_blobs(row: list[Connection], every: Sequence[Connection], whole: Callable[[Blob], bool]) -> list[Blob]:
    """Blobs that only the layers of the row read and write."""
    inside = {id(at) for at in row}
    written = {id(b): b for at in row for b in at.top}
    elsewhere = {id(b) for at in every if id(at) not in inside for b in [*at.bottom, *at.top]}
    return [b for key, b in written.items() if key not in elsewhere and not whole(b)]
