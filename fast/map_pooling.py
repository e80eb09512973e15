"""Pooling over any windows, for a block of maps at a time.

A map is one channel of one image. For winners of maxima, the maps of a block are copied with their
number as last axis (last_axis.py), so that each operation works on long vectors, one value for each
window. Maxima without winners are computed for windows at every place of the padded maps, in
vectors as long as the block. For means, the sum over a window is the sum along the rows of the sums
along the columns. Along the rows, it is computed for all maps of the block in one vector, at every
column and not only where a window starts, and the windows are copied from it:

    v (n, Ho, Wp)   sum over the kh rows of each window, with padded columns
    r (n Ho Wp)     sum of v over kw neighbours, of which every sw-th column is a window
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from fast import parallel
from fast.geometry import Geometry, places_inside
from fast.last_axis import Maps, map_first
from fast.parallel import scratch
from layers.vision.pooling import NOTHING
from netlib.blob import Array, blocks

# of the padded maps of a block; on fewer, two threads wait for the interpreter
BLOCK_BYTES = 1 << 20
MAX_EVERYWHERE = 4  # side of overlapping windows, up to which those at every place take less time
PART = 1 << 15  # values; starting a thread takes longer than pooling fewer


class Windows:
    """What pooling maps (H, W) to maps (Ho, Wo) needs to know of its windows.

    padded           the size of a map with padding, including the parts of windows that extend
                     beyond the padding
    unpadded         the part of a padded map that is not padding
    rows             for each row of the kernel that is inside the map anywhere, the windows in
                     which it is inside, and the rows of the map there
    columns          the first columns of all windows in a padded map
    overlap          whether a value can be in several windows
    is_whole         whether the only window is the map
    runs_everywhere  whether maxima at every place of the padded maps take less time than those
                     of the windows
    """

    def __init__(self, g: Geometry, sizes: tuple[int, int], outputs: tuple[int, int]) -> None:
        self.g, self.sizes, self.outputs = g, sizes, outputs
        self.kernel, self.stride = g.kernel, g.stride
        self.unpadded = g.unpadded(sizes)
        ends = [part.stop for part in self.unpadded]
        self.padded = tuple(map(max, g.extent(outputs), ends))
        down, right = g.stride
        self.rows: list[tuple[slice, slice]] = []
        for i in range(g.kernel[0]):
            first, own = places_inside(i - g.pad[0], down, sizes[0], outputs[0])
            count = own.stop - own.start
            if count:
                self.rows.append((own, slice(first, first + count * down, down)))
        self.columns = slice(0, outputs[1] * right, right)
        self.overlap = any(k > s for k, s in zip(g.kernel, g.stride))
        self.is_whole = g.kernel == sizes and outputs == (1, 1) and not any(g.pad)
        self.runs_everywhere = self.overlap and max(g.kernel) <= MAX_EVERYWHERE

    def maps(self, like: Array, fill: float) -> Maps:
        """Working memory for as many maps as ``like`` (n, H, W) has, filled with one value."""
        return Maps(self.g, self.sizes, self.outputs, like, fill)

    def run(self, maps: int, job: Callable[[slice], None]) -> None:
        """Call ``job`` for all blocks of maps, on several threads if there are enough values."""
        values = max(self.padded[0] * self.padded[1], 1)
        size = max(1, BLOCK_BYTES // (4 * values))
        jobs = [partial(job, rows) for rows in blocks(maps, size)]
        parallel.run(jobs, here=maps * values < 2 * PART)


def running(op: np.ufunc, values: Array, k: int, out: Array) -> None:
    """Write ``op`` over k neighbours along the first axis: out[i] = values[i] op ... op
    values[i + k - 1].

    The last k - 1 elements of ``out`` become any values. A maximum takes log2(k) operations, on
    overlapping parts.
    """
    if k == 1:
        out[...] = values
        return
    out[1 - k :] = values[1 - k :]
    if op is np.maximum and k > 4:
        op(values[:-1], values[1:], out=out[:-1])
        done = 2
        while done < k:
            step = min(done, k - done)
            op(out[:-step], out[step:], out=out[:-step])
            done += step
        return
    last = len(values) - k + 1
    op(values[:last], values[1 : last + 1], out=out[:last])
    for j in range(2, k):
        op(out[:last], values[j : last + j], out=out[:last])


def _over_columns(w: Windows, op: np.ufunc, x: Array, empty: float) -> Array:
    """The padded maxima or sums v (n, Ho, Wp) of maps x (n, H, W) over the rows of each window."""
    v = scratch("pooled rows", (len(x), w.outputs[0], w.padded[1]), x.dtype)
    left, right = w.unpadded[1].start, w.unpadded[1].stop
    v[..., :left] = v[..., right:] = empty
    part = v[..., left:right]
    whole = [(rows, own) for rows, own in w.rows if rows == slice(0, w.outputs[0])]
    rest = [(rows, own) for rows, own in w.rows if rows != slice(0, w.outputs[0])]
    if len(whole) > 1:
        op(x[:, whole[0][1]], x[:, whole[1][1]], out=part)
    elif whole:
        part[...] = x[:, whole[0][1]]
    else:
        part[...] = empty
    for rows, own in [*whole[2:], *rest]:
        op(part[:, rows], x[:, own], out=part[:, rows])
    return v


def _over_rows(w: Windows, op: np.ufunc, v: Array) -> Array:
    """The windows (n, Ho, Wo) of v (n, Ho, Wp), a view of working memory."""
    out = scratch("pooled", v.shape, v.dtype)
    running(op, v.reshape(-1), w.kernel[1], out.reshape(-1))
    return out[..., w.columns]


def _everywhere(w: Windows, x: Array) -> Array:
    """The maxima (n, Ho, Wo) of maps x (n, H, W), a view of working memory.

    They are computed at every place of the padded maps, because operations on one long vector take
    less time than those on the rows and columns where windows start. Windows that extend beyond a
    map or a row are not used.
    """
    (high, wide), (Ho, Wo), (down, right) = w.padded, w.outputs, w.stride
    padded = scratch("padded", (len(x), high, wide), x.dtype)
    source = x
    if (high, wide) != w.sizes:
        padded.fill(-np.inf)
        rows, columns = w.unpadded
        padded[:, rows, columns] = x
        source = padded
    out = scratch("pooled", padded.shape, x.dtype)
    running(np.maximum, source.reshape(-1), w.kernel[1], out.reshape(-1))
    running(np.maximum, out.reshape(-1, wide), w.kernel[0], padded.reshape(-1, wide))
    return padded[:, : Ho * down : down, : Wo * right : right]


def maximum(w: Windows, x: Array, y: Array, winners: Array | None) -> None:
    """Write the maxima y (n, Ho, Wo), and the winners if given, from maps x (n, H, W).

    Winners are indices in the window, in row-major order.
    """
    nothing = np.full(y.shape[2], NOTHING, y.dtype)  # a row takes less time than a number

    def maxima(maps: slice) -> None:
        if w.runs_everywhere:
            found = _everywhere(w, x[maps])
        else:
            found = _over_rows(w, np.maximum, _over_columns(w, np.maximum, x[maps], -np.inf))
        np.maximum(found, nothing, out=y[maps])

    def maxima_and_winners(maps: slice) -> None:
        assert winners is not None
        own = w.maps(x[maps], -np.inf)
        own.read(x[maps])
        best = scratch("pooled", (w.outputs[0], w.outputs[1] * (maps.stop - maps.start)), x.dtype)
        map_first(_with_winners(own, best, winners.dtype.type), winners[maps])
        np.maximum(best, y.dtype.type(NOTHING), out=best)
        map_first(best, y[maps])

    w.run(len(x), maxima if winners is None else maxima_and_winners)


def _with_winners(maps: Maps, best: Array, kind: type[np.unsignedinteger]) -> Array:
    """Write the maxima (Ho, Wo n) to ``best`` and return the winners.

    A later element wins if it is greater.
    """
    winner, mark = scratch("winner", best.shape, kind), scratch("mark", best.shape, kind)
    above = scratch("above", best.shape, np.bool_)
    for k, (_, vector) in enumerate(maps.vectors()):
        if k == 0:
            winner.fill(0)
            best[...] = vector
        else:
            np.greater(vector, best, out=above)
            np.multiply(above.view(np.uint8), kind(k), out=mark)
            np.maximum(winner, mark, out=winner)
            np.maximum(best, vector, out=best)
    if np.isnan(best).any():  # no value is greater than NaN
        for k, (_, vector) in reversed(list(enumerate(maps.vectors()))):
            winner[np.isnan(vector)] = k
    return winner


def maximum_backward(w: Windows, dy: Array, winners: Array, dx: Array) -> None:
    """Write dx (n, H, W): the gradient of each window is added to its winner."""
    (high, wide), (Ho, Wo) = w.padded, w.outputs
    i, j = np.divmod(np.arange(w.kernel[0] * w.kernel[1]), w.kernel[1])
    in_window = i * wide + j
    rows = np.arange(Ho) * (w.stride[0] * wide)
    first = rows[:, None] + np.arange(Wo) * w.stride[1]

    def job(maps: slice) -> None:
        n = maps.stop - maps.start
        index = scratch("index", (n, Ho, Wo), np.intp)
        np.take(in_window, winners[maps], out=index, mode="clip")
        index += first
        index += (np.arange(n) * (high * wide))[:, None, None]
        places, gradient = index.reshape(-1), dy[maps].reshape(-1)
        size = n * high * wide
        if w.overlap:
            total = np.bincount(places, gradient, size)
        else:
            total = scratch("pooled", (size,), dx.dtype)
            total.fill(0)
            total[places] = gradient
        dx[maps] = total.reshape(n, high, wide)[:, w.unpadded[0], w.unpadded[1]]

    w.run(len(dx), job)


def mean(w: Windows, x: Array, y: Array, area: Array) -> None:
    """Write the means y (n, Ho, Wo) of maps x (n, H, W); ``area`` (Ho, Wo) holds the divisor
    of each window.
    """

    def job(maps: slice) -> None:
        # 0 / 0: empty window
        np.divide(_over_rows(w, np.add, _over_columns(w, np.add, x[maps], 0)), area, out=y[maps])

    w.run(len(x), job)


def mean_backward(w: Windows, dy: Array, dx: Array, area: Array) -> None:
    """Write dx (n, H, W): running sums of the gradients of all windows that start at a column."""
    kw = w.kernel[1]
    wide = w.padded[1] + kw - 1
    starts = slice(kw - 1, kw - 1 + w.columns.stop, w.stride[1])
    left, right = w.unpadded[1].start, w.unpadded[1].stop

    def job(maps: slice) -> None:
        shape = (maps.stop - maps.start, w.outputs[0], wide)
        share, total = (scratch(key, shape, dx.dtype) for key in ("pooled rows", "pooled"))
        share.fill(0)
        np.divide(dy[maps], area, out=share[..., starts])
        running(np.add, share.reshape(-1), kw, total.reshape(-1))
        below, gradient = total[..., left:right], dx[maps]
        gradient.fill(0)
        for windows, rows in w.rows:
            gradient[:, rows] += below[:, windows]

    w.run(len(dx), job)
