"""Run layers slice by slice: a few images at a time, one slice per thread.

The first convolution of the paper's network writes 252 MB for a batch of 512, and every layer that
uses such a blob is limited by main memory. A sequence of *batchwise* layers
(item n of a top depends only on item n of the bottoms) therefore runs on one slice of the batch
after the other, so that the blobs of a slice stay in the processor's cache.

Each slice has copies of the layers, with the same parameter values and with small blobs:

- a blob that only this run reads and writes is *unstored*: its values are in working memory of the
  thread, or in memory of the slice if backward needs them again, and it is not stored for the whole
  batch. At a caller's first access it is computed from copies of what the pass has read
  (last_pass.py); the net then stores all blobs;
- a copy of a blob for several readers is the blob itself if no layer overwrites it and there is no
  backward pass;
- any other blob is a view of the whole one.

Slices are assigned to a fixed number of *lanes* in turn. The slices of a lane share parameter
gradients and run one after the other. A free thread runs the next lane. The gradients of the lanes
are summed in order, so results do not depend on the number of threads.

    batch   0..16 | 17..33 | 34..50 | ...       slices, one piece (copies of the layers) each
    lane    0     | 1      | 2      | ...  15 | 0 | 1 ...
    dw = dw(lane 0) + dw(lane 1) + ...          always in this order
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import DTypeLike

from fast import parallel
from fast.fast_layer import FastLayer, is_fused
from fast.last_pass import LastPass, with_params
from fast.parallel import buffer_of
from fast.plan import Run, Use, uses_of
from fast.tiles import FastBlob
from fast.whole_steps import FastStep, whole_steps
from netlib.blob import Array, Blob, Blobs, divide_up
from netlib.engine import Connection, Missing
from netlib.errors import NetlibError

# Limit of a slice: the size of its largest blob, so that its blobs stay in the cache. Smaller
# slices need more calls, in which threads wait for each other, and products of more matrices.
SLICE_BYTES = 16 << 20
# Number of slices for several threads, each with this many multiplications and images.
SPLITS = ((2, 16_000_000, 1), (4, 90_000_000, 8))
MAX_SLICE = 64
LANES = 16
LANE_BYTES = 64 << 20  # of the parameter gradients of all lanes
MIN_LANES = 4
# numbers of items whose division is kept, without a backward pass: a caller's batches vary
RECENT = 4


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


class SlicedStep(FastStep):
    """Several consecutive layers, run slice by slice.

    If some blobs have other numbers of items than the others, because a layer before them, such as
    a Filter, has dropped items, the layers run on the whole batch from then on.
    """

    def __init__(self, run: Run) -> None:
        super().__init__(run.connections[0])
        self.run, self.connections, self.unstored = run, run.connections, run.unstored
        self._users = uses_of(run.order)
        self._needs_backward = any(at.needs_backward for at in run.connections)
        self._read_again = run.read_again()
        self._same = self._fused() | ({} if self._needs_backward else self._copied())
        self._buffers = threading.local()
        self._lanes: list[Lane] = []
        # the lanes for recent shapes of all blobs, the present ones last
        self._divisions: dict[tuple[tuple[int, ...], ...], list[Lane]] = {}
        self._whole: list[FastStep] = []  # if the layers run on the whole batch
        self._is_done = False  # whether the slices have the state of a complete forward pass
        self.last = LastPass(run) if self._is_recorded() else None
        self._outputs, down = run.written(), run.differentiated()
        self._blobs = list(dict.fromkeys(b for at in run.connections for b in at.blobs))
        self._gradients = [b for b in run.read() if b in down] + self._outputs  # whose diff is used
        self._user = {b: at for at in reversed(run.connections) for b in at.blobs}

    def _is_recorded(self) -> bool:
        """Whether values of a pass may be needed that the pass does not store: blobs, or
        what layers keep.
        """
        reads_kept = any(at.layer.reads_kept for at in self.connections)
        return bool(self.unstored) or (self._needs_backward and reads_kept)

    @property
    def key(self) -> tuple[object, ...]:
        """The run."""
        return SlicedStep, *self.run.key

    def has_state(self) -> bool:
        """Whether the last forward pass of the slices is complete."""
        return self._is_done

    def pieces(self) -> list[list[Connection]]:
        """The layers of every slice in execution order."""
        self.prepare()
        return [piece.connections for lane in self._lanes for piece in lane] or [
            [step.at] for step in self._whole
        ]

    def forward(self) -> None:
        """Run the layers forwards on all slices."""
        self._is_done = False
        if self.last is not None:
            self.last.begin()
        for blob in self._outputs:
            with self._user[blob].errors:
                blob.data  # noqa: B018 - allocates here, not on several threads at once
        parallel.run([partial(self._forward, lane) for lane in self._lanes])
        for step in self._whole:
            step.forward()
        self._is_done = True
        if self.last is not None:
            self.last.finish()

    def _forward(self, lane: Lane) -> None:
        for piece in lane:
            if self.last is not None:
                self.last.copy_inputs(piece.rows)
            for at in piece.connections:
                if not is_fused(at.layer):
                    with at.errors:
                        at.layer.forward(at.bottom, at.top)

    def backward(self, at_once: bool = False) -> None:
        """Run the layers backwards on all slices, and sum the gradients of the parameters.

        Unless it is ``at_once``, raises NetlibError if a caller has written an input since forward.
        """
        if not self._needs_backward:
            return
        for step in reversed(self._whole):
            step.backward()
        if self.last is not None:
            self.last.begin_backward(at_once)
        for blob in self._gradients:
            with self._user[blob].errors:
                blob.diff  # noqa: B018
        parallel.run([partial(self._backward, lane, at_once) for lane in self._lanes])
        for i, at in enumerate(self.run.order):
            for j, param in enumerate(at.layer.blobs):
                for lane in self._lanes:
                    param.diff[...] += lane[0].connections[i].layer.blobs[j].diff
        if self.last is not None:
            self.last.finish_backward()

    def _backward(self, lane: Lane, at_once: bool) -> None:
        for at in lane[0].connections:
            for param in at.layer.blobs:
                param.diff[...] = 0
        for piece in lane:
            if self.last is not None:
                self.last.copy_top_diffs(piece.rows)
                if not at_once and (blob := self.last.written_input(piece.rows)):
                    raise self._written(blob)
            for at in reversed(piece.connections):
                if at.needs_backward:
                    with at.errors:
                        at.layer.backward(at.top, at.propagate_down, at.bottom)

    def store(self) -> Missing:
        """Store the unstored blobs of the last pass, and let the layers keep what they
        need for backward.
        """
        if self.last is not None:
            return self.last.store()
        missing = [self.lost or Missing({}), *(step.store() for step in self._whole)]
        halves = {blob: half for part in missing for blob, half in part.halves.items()}
        return Missing(halves, [at for part in missing for at in part.layers])

    def begin(self) -> None:
        """Forget the last pass of layers that run on the whole batch."""
        for step in self._whole:
            step.begin()

    def finish(self) -> None:
        """Copy the sources of which a caller has an array, if the layers run on the whole batch."""
        for step in self._whole:
            step.finish()

    def keep(self, source: Blob) -> None:
        """Copy a source, likewise."""
        for step in self._whole:
            if source in step.sources:
                step.keep(source)

    def _written(self, blob: Blob) -> NetlibError:
        """The error for an input that a caller has written between forward and backward."""
        at = self._user[blob]
        name = at.layer.spec.bottom[at.bottom.index(blob)]
        first = self.connections[0].layer.spec.top[0]
        return NetlibError(
            f"blob {name!r} was written between forward and backward, which would give the gradient of no pass: run "
            f"forward again, or read a blob such as {first!r} before, so that the net stores all blobs"
        )

    def _is_cut(self) -> bool:
        """Whether the batch is divided into slices for the current shapes, now or recently."""
        shapes = self._shapes()
        lanes = self._divisions.get(shapes, [])
        if lanes and lanes is not self._lanes:
            self._lanes = self._divisions[shapes] = self._divisions.pop(shapes)
        return bool(lanes)

    def _shapes(self) -> tuple[tuple[int, ...], ...]:
        return tuple(blob.shape for blob in self._blobs)

    def prepare(self) -> None:
        """Divide the batch into slices unless this was done for the current shapes."""
        if self._whole or self._is_cut():
            return
        for at in self.connections:
            with at.errors:
                at.layer.reshape(at.bottom, at.top)
        if len({b.shape[:1] for at in self.connections for b in at.blobs}) > 1:
            self._run_whole()
            return
        items = self.at.bottom[0].shape[0]
        each = max(items, 1)
        largest = max(
            b.count * b.dtype.itemsize // each for at in self.run.connections for b in at.top
        )
        number = _slice_count(items, largest, sum(_cost(at) for at in self.run.connections) // each)
        param_bytes = sum(p.bytes for at in self.run.connections for p in at.layer.blobs)
        count = min(LANES, max(LANE_BYTES // max(param_bytes, 1), MIN_LANES))
        lanes: list[Lane] = []
        for i, rows in enumerate(_nearly_equal(items, number)):
            if i < count:
                params = [Blobs([ParamOfLane(p) for p in at.layer.blobs]) for at in self.run.order]
                lanes.append([])
            else:
                params = [at.layer.blobs for at in lanes[i % count][0].connections]
            lanes[i % count].append(self._piece(rows, params))
        before = [] if self._needs_backward else [*self._divisions.items()][1 - RECENT :]
        self._lanes, self._divisions = lanes, dict([*before, (self._shapes(), lanes)])

    def _run_whole(self) -> None:
        """Run the layers on the whole batch from now on."""
        self.lost = self.store()
        whole = whole_steps(self.connections, set(self._blobs))
        self.sources = [blob for step in whole for blob in step.sources]
        unstored = [blob for step in whole for blob in step.unstored]
        # in one statement, so that an interrupt leaves all of them or none
        self._whole, self._lanes, self.unstored, self.last = whole, [], unstored, None

    def _piece(self, rows: slice, params: list[Blobs]) -> Piece:
        """Create the layers of one slice."""
        blobs: dict[Blob, Blob] = {}

        def on_slice(whole: Blob) -> Blob:
            if whole not in blobs:
                source = self._same.get(whole)
                blobs[whole] = (
                    on_slice(source) if source is not None else self._slice_blob(whole, rows)
                )
            return blobs[whole]

        connections = []
        for at, own_params in zip(self.run.order, params):
            bottom, top = Blobs(map(on_slice, at.bottom)), Blobs(map(on_slice, at.top))
            layer = with_params(at.layer, own_params)
            connections.append(Connection(layer, bottom, top, at.propagate_down, at.needs_backward))
            with connections[-1].errors:
                layer.reshape(bottom, top)
        return Piece(rows, connections)

    def _copied(self) -> dict[Blob, Blob]:
        """Unstored tops of Split layers that no layer overwrites, and the bottoms whose memory
        they can share.
        """
        sources: dict[Blob, Blob] = {}
        for at in self.run.order:
            if at.layer.type == "Split" and self._users[at.bottom[0]][-1].at is at:
                uses = [use for top in at.top for use in self._users[top]]
                writes = sum(use.writes for use in uses)
                if all(top in self.unstored for top in at.top) and writes == len(at.top):
                    sources |= dict.fromkeys(at.top, at.bottom[0])
        return sources

    def _fused(self) -> dict[Blob, Blob]:
        """Unstored blobs in place of which a layer writes the top of one that it computes."""
        found: dict[Blob, Blob] = {}
        for step in whole_steps(self.run.connections, set()):
            found |= dict.fromkeys(step.unstored, step.connections[-1].top[0])
        return found

    def _slice_blob(self, whole: Blob, rows: slice) -> Blob:
        shape = (rows.stop - rows.start, *whole.shape[1:])
        if whole not in self.run.unstored:
            return Window(whole, rows, shape)
        blob = SliceBlob(shape, whole.dtype, self._buffers, id(whole), whole in self._read_again)
        blob.tile = self.run.tiles.get(whole)
        uses = self._users[whole]
        blob.may_be_sparse = (
            blob.tile is not None and len(uses) == 2 and all(map(_can_be_sparse, uses))
        )
        return blob


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
