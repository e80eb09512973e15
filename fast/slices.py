"""Run layers slice by slice: a few images at a time, one slice per thread.

The first convolution of the paper's network writes 252 MB for a batch of 512, and every layer that uses such a blob is
limited by main memory. A sequence of *batchwise* layers (item n of a top depends only on item n of the bottoms)
therefore runs on one slice of the batch after the other, so that the blobs of a slice stay in the processor's cache.

Each slice has copies of the layers, with the same parameter values and with small blobs:

- a blob that only this run reads and writes is *hidden*: its values are in working memory of the thread, or in memory
  of the slice if backward needs them again, and it is not stored for the whole batch;
- a copy of a blob for several readers is the blob itself if no layer overwrites it and there is no backward pass;
- any other blob is a view of the whole one.

Slices are assigned to a fixed number of *lanes* in turn. The slices of a lane share parameter gradients and run one
after the other. A free thread runs the next lane. The gradients of the lanes are summed in order, so results do not
depend on the number of threads.

    batch   0..16 | 17..33 | 34..50 | ...       slices, one piece (copies of the layers) each
    lane    0     | 1      | 2      | ...  15 | 0 | 1 ...
    dw = dw(lane 0) + dw(lane 1) + ...          always in this order
"""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable
from functools import partial

import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from fast.plan import Run, Use, uses_of
from fast.slice_blobs import Hidden, ParamOfLane, Window
from fast.traits import traits_of
from netlib.blob import Array, Blob, Blobs
from netlib.engine.checks import guarded, lacking
from netlib.engine.plain import BackwardHook, Connection, Step
from netlib.layer import Layer

# Limit of a slice: the size of its largest blob, so that its blobs stay in the cache. Smaller slices need more calls,
# in which threads wait for each other, and products of more matrices.
SLICE_BYTES = 16 << 20
# Number of slices for several threads, each with this many multiplications and images.
SPLITS = ((2, 16_000_000, 1), (4, 90_000_000, 8))
MAX_SLICE = 64
LANES = 16
LANE_BYTES = 64 << 20  # of the parameter gradients of all lanes
MIN_LANES = 4
RECENT = 4  # numbers of items whose division is kept, without a backward pass: a caller's batches vary

Piece = list[Connection]  # the layers of a run, for one slice
Lane = list[Piece]  # slices that share parameter gradients


class SlicedStep(Step):
    """Several consecutive layers, run slice by slice."""

    def __init__(self, run: Run) -> None:
        super().__init__(run.connections[0])
        self.run = run
        self._secret, self._users = set(run.hidden), uses_of(run.order)
        self._needs_backward = any(at.needs_backward for at in run.connections)
        self._kept = {b for at in run.order for b in _read_again(at)}
        self._sources = {} if self._needs_backward else self._copied()
        self._buffers = threading.local()
        self._shapes: list[tuple[int, ...]] = []
        self._lanes: list[Lane] = []
        self._recent: dict[tuple[tuple[int, ...], ...], list[Lane]] = {}
        self.weights: list[tuple[Blob, Array]] = []  # parameters, their values in the last forward
        self.weights_back: list[tuple[Blob, Array]] = []  # parameters, their values in the last backward
        self._inputs, self._outputs = run.outside("bottom"), run.outside("top")
        down = {b for at in run.connections for b, wanted in zip(at.bottom, at.propagate_down) if wanted}
        self._whole = [*self._inputs, *self._outputs]
        self._gradients = [b for b in self._inputs if b in down] + self._outputs  # whose diff is used
        self._user = {b: at for at in reversed(run.connections) for b in [*at.bottom, *at.top]}

    def pieces(self) -> list[Piece]:
        """The layers of every slice in execution order."""
        self._reshape()
        return [piece for lane in self._lanes for piece in lane]

    def forward(self) -> None:
        """Run the layers forwards on all slices."""
        self._reshape()
        self._copy_weights(self.weights)
        for blob in self._outputs:
            self._ensure(blob, "data")  # allocate here, not on several threads at once
        parallel.run([partial(self._forward, lane) for lane in self._lanes])

    def _forward(self, lane: Lane) -> None:
        for piece in lane:
            for at in piece:
                guarded(at.layer, "forward", at.bottom, at.top)

    def backward(self, on_done: BackwardHook | None = None) -> None:
        """Run the layers backwards on all slices, and sum the gradients of the parameters."""
        if not self._needs_backward:
            return
        self._copy_weights(self.weights_back)
        for blob in self._gradients:
            self._ensure(blob, "diff")
        caller = threading.get_ident()
        between = (lambda: threading.get_ident() == caller and on_done(None)) if on_done else lambda: None
        parallel.run([partial(self._backward, lane, between) for lane in self._lanes])
        for i, at in enumerate(self.run.order):
            for j, param in enumerate(at.layer.blobs):
                for lane in self._lanes:
                    param.diff[...] += lane[0][i].layer.blobs[j].diff

    def _backward(self, lane: Lane, between: Callable[[], object]) -> None:
        for at in lane[0]:
            for param in at.layer.blobs:
                param.diff[...] = 0
        for piece in lane:
            for at in reversed(piece):
                if at.needs_backward:
                    guarded(at.layer, "backward", at.top, at.propagate_down, at.bottom)
                    between()

    def _ensure(self, blob: Blob, half: str) -> None:
        """Allocate ``data`` or ``diff`` of a blob. Raises OutOfMemoryError."""
        try:
            getattr(blob, half)
        except MemoryError as error:
            raise lacking(self._user[blob].layer, half, error) from error

    def _copy_weights(self, copies: list[tuple[Blob, Array]]) -> None:
        """Copy the current parameters to ``copies``, whose memory is used again."""
        params = [p for at in self.run.connections for p in at.layer.blobs]
        if [(p, p.shape) for p in params] != [(p, values.shape) for p, values in copies]:
            copies[:] = [(p, np.empty_like(p.data)) for p in params]
        for param, values in copies:
            values[...] = param.data

    def _is_cut(self) -> bool:
        """Whether the batch is divided into slices for the current shapes, now or recently."""
        shapes = [b.shape for b in self._whole]
        if shapes != self._shapes and (lanes := self._recent.pop(tuple(shapes), None)):
            self._recent[tuple(shapes)] = lanes  # as the last one
            self._lanes, self._shapes = lanes, shapes
        return bool(self._lanes) and shapes == self._shapes

    def is_even(self) -> bool:
        """Reshape the blobs if inputs have new shapes. Returns whether all blobs have the same number of items."""
        if self._is_cut():
            return True
        self._shape_blobs()
        return len({b.shape[:1] for at in self.run.connections for b in [*at.bottom, *at.top]}) == 1

    def _shape_blobs(self) -> None:
        for at in self.run.connections:
            guarded(at.layer, "reshape", at.bottom, at.top)

    def _reshape(self) -> None:
        """Divide the batch into slices unless this was done for the current shapes."""
        if self._is_cut():
            return
        self._shape_blobs()
        items = self.at.bottom[0].shape[0]
        each = max(items, 1)
        largest = max(b.count * b.dtype.itemsize // each for at in self.run.connections for b in at.top)
        number = _slice_count(items, largest, sum(_cost(at) for at in self.run.connections) // each)
        param_bytes = sum(p.bytes for at in self.run.connections for p in at.layer.blobs)
        count = min(LANES, max(LANE_BYTES // max(param_bytes, 1), MIN_LANES))
        lanes: list[Lane] = []
        for i, rows in enumerate(_nearly_equal(items, number)):
            if i < count:
                params = [Blobs([ParamOfLane(p) for p in at.layer.blobs]) for at in self.run.order]
                lanes.append([])
            else:
                params = [at.layer.blobs for at in lanes[i % count][0]]
            lanes[i % count].append(self._piece(rows, params))
        self._lanes, self._shapes = lanes, [b.shape for b in self._whole]
        if not self._needs_backward:
            self._recent = dict([*self._recent.items()][1 - RECENT :])
            self._recent[tuple(self._shapes)] = lanes

    def _piece(self, rows: slice, params: list[Blobs]) -> Piece:
        """Create the layers of one slice."""
        blobs: dict[Blob, Blob] = {}

        def on_slice(whole: Blob) -> Blob:
            if whole not in blobs:
                source = self._sources.get(whole)
                blobs[whole] = on_slice(source) if source is not None else self._slice_blob(whole, rows)
            return blobs[whole]

        piece = []
        for at, own_params in zip(self.run.order, params):
            bottom, top = Blobs(map(on_slice, at.bottom)), Blobs(map(on_slice, at.top))
            layer = _with_params(at.layer, own_params)
            guarded(layer, "reshape", bottom, top)
            piece.append(Connection(layer, bottom, top, at.propagate_down, at.needs_backward))
        return piece

    def _copied(self) -> dict[Blob, Blob]:
        """Hidden tops of Split layers that no layer overwrites, and the bottoms whose memory they can share."""
        sources: dict[Blob, Blob] = {}
        for at in self.run.order:
            if at.layer.type == "Split" and self._users[at.bottom[0]][-1].at is at:
                uses = [use for top in at.top for use in self._users[top]]
                if all(top in self._secret for top in at.top) and sum(use.writes for use in uses) == len(at.top):
                    sources |= dict.fromkeys(at.top, at.bottom[0])
        return sources

    def _slice_blob(self, whole: Blob, rows: slice) -> Blob:
        shape = (rows.stop - rows.start, *whole.shape[1:])
        if whole not in self._secret:
            return Window(whole, rows, shape)
        blob = Hidden(shape, whole.dtype, self._buffers, id(whole), whole in self._kept)
        blob.tile = self.run.tiles.get(whole)
        uses = self._users[whole]
        blob.may_be_sparse = blob.tile is not None and len(uses) == 2 and all(map(_can_be_sparse, uses))
        return blob


def _can_be_sparse(use: Use) -> bool:
    """Whether a layer can write or read a blob of which only some windows are stored."""
    layer = use.at.layer
    if not isinstance(layer, FastLayer):
        return False
    return (layer.writes_sparse() or not use.writes) and (layer.reads_sparse() or not use.reads)


def _with_params(layer: Layer, params: Blobs) -> Layer:
    """Copy a layer for one slice of a batch, with the same options and the given parameters."""
    other = copy.copy(layer)
    other.blobs = params
    if isinstance(other, FastLayer):
        other.forget()
    of_layer = {id(param): of_lane for param, of_lane in zip(layer.blobs, params)}
    for name, value in vars(layer).items():  # self.weight, self.bias
        if id(value) in of_layer:
            setattr(other, name, of_layer[id(value)])
    return other


def _slice_count(items: int, item_bytes: int, item_cost: int) -> int:
    """Number of slices, even if there are several. Those of the hand network have 32 images."""
    count = -(-items // max(1, min(MAX_SLICE, SLICE_BYTES // max(item_bytes, 1))))
    size = -(-items // _even(count))
    for wanted, cost, images in SPLITS:
        while size > 1 and size * wanted > items and size // 2 >= images and size // 2 * item_cost >= cost:
            size //= 2
    return _even(-(-items // size)) if size else 0


def _even(count: int) -> int:
    return count + count % 2 if count > 1 else max(count, 1)


def _nearly_equal(items: int, count: int) -> list[slice]:
    """Divide the items into slices, the larger ones first, so that two threads end at the same time."""
    ends = np.cumsum([items // count + (i < items % count) for i in range(min(count, items))]).tolist()
    return [slice(start, end) for start, end in zip([0, *ends], ends)]


def _cost(at: Connection) -> int:
    """Multiplications of a layer, approximately: one per value, or per weight of an output."""
    values = max(b.count for b in [*at.bottom, *at.top])
    return values * max([1, *(p.count // max(p.shape[0], 1) for p in at.layer.blobs if p.shape)])


def _read_again(at: Connection) -> list[Blob]:
    """The blobs whose data a layer's backward reads."""
    if not at.needs_backward:
        return []
    traits = traits_of(at.layer)
    return [*(at.bottom if traits.reads_bottom else []), *(at.top if traits.reads_top else [])]
