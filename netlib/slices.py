"""Run layers slice by slice: a few images at a time, one slice a thread.

The first convolution of the paper's network writes 252 MB for a batch of 512, and every layer that touches
such a blob pays for main memory. So the net runs a row of *batchwise* layers (item n of a top depends only on
item n of the bottoms) on one slice of the batch after the other: a slice's blobs stay in the processor's cache.

The layers know nothing of it. Each slice has twins of the layers, with the same parameter values and with
little blobs of their own:

- a blob that only this run reads and writes is *hidden*: its values live in the working memory of the thread,
  or with the slice if backward needs them again; the whole blob never exists;
- any other blob is a window on the whole one.

Slices are dealt to a fixed number of *lanes*. A lane's slices share parameter gradients and run one after the other;
a thread takes the next lane when it is free; the lanes are summed in order. So results do not depend on the number
of threads.

    batch   0..16 | 17..33 | 34..50 | ...       slices, one piece (twins of the layers) each
    lane    0     | 1      | 2      | ...  15 | 0 | 1 ...
    dw = dw(lane 0) + dw(lane 1) + ...          always in this order

Two freedoms are used, both exact. A hidden blob between two layers that agree on it is *tiled* (see blob.py). And
a monotone layer in place (ReLU) before a max pooling runs after it, on a sixteenth of the values: max(f(a), f(b))
= f(max(a, b)), and the gradient takes the same way.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from netlib import parallel
from netlib.blob import Array, Blob, Blobs
from netlib.layer import Layer

# Aim for the largest blob of a slice; less is more calls, and threads wait for each other in calls.
SLICE_BYTES = 16 << 20
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


Piece = list[Connection]  # the twins of all layers of a run, for one slice
Lane = list[Piece]  # slices that share parameter gradients


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
        if at.layer.steady:
            if shapes != self._shapes:
                at.layer.reshape(at.bottom, at.top)
                self._shapes = shapes
            at.layer.forward(at.bottom, at.top)
        else:  # somebody's own layer: its mistakes are told with its name
            at.layer.guarded("reshape", at.bottom, at.top)
            at.layer.guarded("forward", at.bottom, at.top)

    def pieces(self) -> list[Piece]:
        """The layer, for the whole batch."""
        return [self.connections]

    def backward(self) -> None:
        """Compute the diffs, if somebody needs them."""
        at = self.connections[0]
        if at.needs_backward and at.layer.steady:
            at.layer.backward(at.top, at.propagate_down, at.bottom)
        elif at.needs_backward:
            at.layer.guarded("backward", at.top, at.propagate_down, at.bottom)


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
        self._lanes: list[Lane] = []
        self.weights: list[tuple[Array, Array]] = []  # parameters, and their values in the last forward
        self._inputs, self._outputs = self.outside("bottom"), self.outside("top")
        down = {id(b) for at in connections for b, wanted in zip(at.bottom, at.propagate_down) if wanted}
        self._gradients = [b for b in self._inputs if id(b) in down] + self._outputs  # whose diff is written or read

    def outside(self, blobs: str) -> list[Blob]:
        """The whole blobs that the run reads (``"bottom"``) or writes (``"top"``)."""
        secret = {id(b) for b in self.hidden}
        return [b for at in self.connections for b in getattr(at, blobs) if id(b) not in secret]

    def pieces(self) -> list[Piece]:
        """The twins of the layers for every slice, in the order in which they run."""
        self._reshape()
        return [piece for lane in self._lanes for piece in lane]

    def forward(self) -> None:
        """Run the layers forwards on all slices."""
        self._reshape()
        self.weights = [(p.data, p.data.copy()) for at in self.connections for p in at.layer.blobs]
        for blob in self._outputs:
            blob.ensure("data")  # memory is taken here, not by several threads at once
        parallel.run([partial(self._forward, lane) for lane in self._lanes])

    def _forward(self, lane: Lane) -> None:
        for piece in lane:
            for at in piece:
                at.layer.forward(at.bottom, at.top)

    def backward(self) -> None:
        """Run the layers backwards on all slices, and add up the gradients of the parameters."""
        if not self.needs_backward:
            return
        for blob in self._gradients:
            blob.ensure("diff")
        parallel.run([partial(self._backward, lane) for lane in self._lanes])
        for i, at in enumerate(self._order):
            for j, whole in enumerate(at.layer.blobs):
                for lane in self._lanes:
                    whole.diff[...] += lane[0][i].layer.blobs[j].diff

    def _backward(self, lane: Lane) -> None:
        for at in lane[0]:
            for param in at.layer.blobs:
                param.diff[...] = 0
        for piece in lane:
            for at in reversed(piece):
                if at.needs_backward:
                    at.layer.backward(at.top, at.propagate_down, at.bottom)

    def _reshape(self) -> None:
        """Cut the batch into slices, if that is not done yet for these shapes."""
        shapes = [b.shape for b in self._inputs]
        if shapes == self._shapes and self._lanes:
            return
        for at in self.connections:
            at.layer.reshape(at.bottom, at.top)
        items = self.connections[0].bottom[0].shape[0]
        largest = max(b.count * b.dtype.itemsize // max(items, 1) for at in self.connections for b in at.top)
        slices = parallel.blocks(items, _slice_size(largest))
        lanes: list[Lane] = []
        for i, rows in enumerate(slices):
            if i < LANES:
                params = [Blobs([_ParamTwin(p) for p in at.layer.blobs]) for at in self._order]
                lanes.append([])
            else:
                params = [at.layer.blobs for at in lanes[i % LANES][0]]
            lanes[i % LANES].append(self._piece(rows, params))
        self._lanes, self._shapes = lanes, shapes

    def _piece(self, rows: slice, params: list[Blobs]) -> Piece:
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


def _slice_size(item_bytes: int) -> int:
    """Items of a slice: a power of two, so that products divide into equal parts; 32 images of the hand network."""
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
        return parallel.buffer_of(self._buffers, f"{half}{self._key}", self.storage_shape, self.dtype)


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


def plan(connections: Sequence[Connection], stored: Callable[[Blob], bool]) -> list[WholeStep | SlicedRun]:
    """Arrange the layers of a net into steps. Blobs for which ``stored`` is true are never hidden."""
    steps: list[WholeStep | SlicedRun] = []
    run: list[Connection] = []  # layers that could run in slices together
    for at in connections:
        if _fits(run, at):
            run.append(at)
            continue
        steps += _steps_for(run, connections, stored)
        run = [at] if _fits([], at) else []
        if not run:
            steps.append(WholeStep(at))
    return steps + _steps_for(run, connections, stored)


def _fits(run: list[Connection], at: Connection) -> bool:
    """May this layer join the run?"""
    if not at.layer.batchwise or not at.bottom:
        return False
    items = {blob.shape[0] if blob.shape else None for blob in [*at.bottom, *at.top]}
    if len(items) != 1 or items == {None}:
        return False
    if not run:  # a first layer in place would change its own input, which could then not be read twice
        return all(blob is not top for blob in at.bottom for top in at.top)
    return run[0].bottom[0].shape[0] == at.bottom[0].shape[0]


def _steps_for(
    run: list[Connection], connections: Sequence[Connection], stored: Callable[[Blob], bool]
) -> list[WholeStep | SlicedRun]:
    """The steps for layers that could run in slices.

    A layer that overwrites a stored blob in place must not run twice (Net._repeat would), unless that changes
    nothing. Such a layer ends the run, and from it on the layers are whole.
    """
    hidden = _hidden_blobs(run, connections, stored)
    end = next((i for i, at in enumerate(run) if _overwrites(at, hidden) and not at.layer.monotone), None)
    if end is not None:
        return _steps_for(run[:end], connections, stored) + [WholeStep(at) for at in run[end:]]
    if all(at.layer.elementwise for at in run):  # nothing to gain; also the empty run
        return [WholeStep(at) for at in run]
    return [SlicedRun(run, hidden)]


def _overwrites(at: Connection, hidden: list[Blob]) -> bool:
    """Does the layer run in place on a blob that is stored?"""
    secret = {id(blob) for blob in hidden}
    return any(blob is top and id(blob) not in secret for blob in at.bottom for top in at.top)


def _hidden_blobs(
    run: list[Connection], connections: Sequence[Connection], stored: Callable[[Blob], bool]
) -> list[Blob]:
    """Blobs that only the layers of the run read and write."""
    inside = {id(at) for at in run}
    written = {id(blob): blob for at in run for blob in at.top}
    elsewhere = {id(blob) for at in connections if id(at) not in inside for blob in [*at.bottom, *at.top]}
    return [blob for key, blob in written.items() if key not in elsewhere and not stored(blob)]
