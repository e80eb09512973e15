"""Division of a batch into slices, each with copies of the layers that run on it.

The copies have the parameter values of the layers, and small blobs:

- a blob that only this run reads and writes is *unstored*: its values are in working memory of the
  thread, or in memory of the slice if backward needs them again, and it is not stored for the whole
  batch. At a caller's first access it is computed from copies of what the pass has read
  (last_pass.py); the net then stores all blobs;
- a copy of a blob for several readers is the blob itself if no layer overwrites it and there is no
  backward pass;
- any other blob is a view of the whole one.

Slices are assigned to a fixed number of *lanes* in turn. The slices of a lane share parameter
gradients.

    batch   0..16 | 17..33 | 34..50 | ...       slices, one piece (copies of the layers) each
    lane    0     | 1      | 2      | ...  15 | 0 | 1 ...
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike

from fast import parallel
from fast.fast_layer import FastLayer
from fast.last_pass import with_params
from fast.parallel import buffer_of
from fast.plan import Run, Use, uses_of
from fast.tiles import FastBlob
from fast.whole_steps import whole_steps
from netlib.blob import Array, Blob, Blobs, divide_up
from netlib.engine import Connection

# Limit of a slice: the size of its largest blob, so that its blobs stay in the cache. Smaller
# slices need more calls, in which threads wait for each other, and products of more matrices.
SLICE_BYTES = 16 << 20
# Number of slices for several threads, each with this many multiplications and images.
SPLITS = ((2, 16_000_000, 1), (4, 90_000_000, 8))
MAX_SLICE = 64
LANES = 16
LANE_BYTES = 64 << 20  # of the parameter gradients of all lanes
MIN_LANES = 4


@dataclass
class Piece:
    """The layers of a run, for the items ``rows``."""

    rows: slice
    connections: list[Connection]


Lane = list[Piece]  # slices that share parameter gradients


class Window(Blob):
    """A view of some items of a whole blob."""

    def __init__(self, whole: Blob, rows: slice, shape: tuple[int, ...]) -> None:
        super().__init__(shape, whole.dtype)
        self._whole, self._rows = whole, rows

    @property
    def data(self) -> Array:
        """The values of these items."""
        return self._whole.data[self._rows]

    @property
    def diff(self) -> Array:
        """The gradients of these items."""
        return self._whole.diff[self._rows]


class SliceBlob(FastBlob):
    """An unstored blob of one slice.

    Its diff, and its data unless backward reads them again, are valid only until the thread's next
    slice.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: DTypeLike,
        buffers: threading.local,
        key: int,
        is_read_again: bool,
    ) -> None:
        super().__init__(shape, dtype)
        self._buffers, self._key, self._is_read_again = buffers, key, is_read_again
        self._own: Array | None = None

    @property
    def data(self) -> Array:
        """The values: memory of the slice if backward reads them again, else working memory
        of the thread.
        """
        if self._is_read_again:
            if self._own is None:
                self._own = parallel.aligned(self.storage_shape, self.dtype, np.zeros)
            return self._own
        return self._buffer("data")

    @property
    def diff(self) -> Array:
        """The gradient, in working memory of the thread."""
        return self._buffer("diff")

    def _buffer(self, half: str) -> Array:
        return buffer_of(self._buffers, f"{half}{self._key}", self.storage_shape, self.dtype)


class ParamOfLane(Blob):
    """A parameter of one lane, which shares the values of the original and has its own diff."""

    def __init__(self, original: Blob) -> None:
        super().__init__(original.shape, original.dtype)
        self._original = original

    @property
    def data(self) -> Array:
        """The values of the original parameter."""
        return self._original.data


class Division:
    """Divides the batch of a run, for any number of items.

    run             the layers, with the blobs of the net
    needs_backward  whether any of the layers has a backward pass
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        self.needs_backward = any(at.needs_backward for at in run.connections)
        self._users = uses_of(run.order)
        self._read_again = run.read_again()
        # unstored blobs that are another blob in a slice
        self._same = self._fused() | ({} if self.needs_backward else self._copied())
        self._buffers = threading.local()

    def lanes(self, items: int) -> list[Lane]:
        """Create the slices of a batch for the present shapes, by lanes; none without items."""
        connections = self.run.connections
        each = max(items, 1)
        sizes = [b.count * b.dtype.itemsize // each for at in connections for b in at.top]
        cost = sum(_cost(at) for at in connections) // each
        number = _slice_count(items, max(sizes), cost)
        param_bytes = sum(p.bytes for at in connections for p in at.layer.blobs)
        count = min(LANES, max(LANE_BYTES // max(param_bytes, 1), MIN_LANES))
        lanes: list[Lane] = []
        for i, rows in enumerate(_nearly_equal(items, number)):
            if i < count:  # the first slice of its lane
                params = [Blobs([ParamOfLane(p) for p in at.layer.blobs]) for at in self.run.order]
                lanes.append([])
            else:
                params = [at.layer.blobs for at in lanes[i % count][0].connections]
            lanes[i % count].append(self._piece(rows, params))
        return lanes

    def _piece(self, rows: slice, params: list[Blobs]) -> Piece:
        """Create the layers of one slice."""
        blobs: dict[Blob, Blob] = {}

        def on_slice(whole: Blob) -> Blob:
            if whole not in blobs:
                same = self._same.get(whole)
                blobs[whole] = self._new_blob(whole, rows) if same is None else on_slice(same)
            return blobs[whole]

        connections = []
        for at, own_params in zip(self.run.order, params):
            bottom, top = Blobs(map(on_slice, at.bottom)), Blobs(map(on_slice, at.top))
            layer = with_params(at.layer, own_params)
            connections.append(Connection(layer, bottom, top, at.propagate_down, at.needs_backward))
            with connections[-1].errors:
                layer.reshape(bottom, top)
        return Piece(rows, connections)

    def _new_blob(self, whole: Blob, rows: slice) -> Blob:
        """The blob of a slice for a whole one: a view of it, or memory of its own."""
        shape = (rows.stop - rows.start, *whole.shape[1:])
        if whole not in self.run.unstored:
            return Window(whole, rows, shape)
        blob = SliceBlob(shape, whole.dtype, self._buffers, id(whole), whole in self._read_again)
        blob.tile = self.run.tiles.get(whole)
        uses = self._users[whole]
        users_agree = len(uses) == 2 and all(map(_can_be_sparse, uses))
        blob.may_be_sparse = blob.tile is not None and users_agree
        return blob

    def _copied(self) -> dict[Blob, Blob]:
        """Unstored tops of Split layers that no layer overwrites, and the bottoms whose memory
        they can share.
        """
        sources: dict[Blob, Blob] = {}
        for at in self.run.order:
            if at.layer.type != "Split" or any(top not in self.run.unstored for top in at.top):
                continue
            is_last_user = self._users[at.bottom[0]][-1].at is at
            writes = sum(use.writes for top in at.top for use in self._users[top])
            if is_last_user and writes == len(at.top):  # the Split's own
                sources |= dict.fromkeys(at.top, at.bottom[0])
        return sources

    def _fused(self) -> dict[Blob, Blob]:
        """Unstored blobs in place of which a layer writes the top of one that it computes."""
        found: dict[Blob, Blob] = {}
        for step in whole_steps(self.run.connections, set()):
            found |= dict.fromkeys(step.unstored, step.connections[-1].top[0])
        return found


def _can_be_sparse(use: Use) -> bool:
    """Whether a layer can write or read a blob of which only some windows are stored."""
    layer = use.at.layer
    if not isinstance(layer, FastLayer):
        return False
    return (layer.writes_sparse() or not use.writes) and (layer.reads_sparse() or not use.reads)


def _slice_count(items: int, item_bytes: int, item_cost: int) -> int:
    """Number of slices, even if there are several. Those of the hand network have 32 images."""
    fitting = SLICE_BYTES // max(item_bytes, 1)
    count = divide_up(items, max(1, min(MAX_SLICE, fitting)))
    size = divide_up(items, _even(count))
    for wanted, cost, images in SPLITS:
        while size * wanted > items:
            half = size // 2
            if half < images or half * item_cost < cost:
                break
            size = half
    return _even(divide_up(items, size)) if size else 0


def _even(count: int) -> int:
    return count + count % 2 if count > 1 else max(count, 1)


def _nearly_equal(items: int, count: int) -> list[slice]:
    """Divide the items into slices, the larger ones first, so that two threads end at
    the same time.
    """
    sizes = [items // count + (i < items % count) for i in range(min(count, items))]
    ends = np.cumsum(sizes).tolist()
    return [slice(start, end) for start, end in zip([0, *ends], ends)]


def _cost(at: Connection) -> int:
    """Multiplications of a layer, approximately: one per value, or per weight of an output."""
    values = max(b.count for b in [*at.bottom, *at.top])
    params = [p for p in at.layer.blobs if p.shape]
    return values * max([1, *(p.count // max(p.shape[0], 1) for p in params)])
