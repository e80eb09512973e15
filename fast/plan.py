"""Which layers of a net run slice by slice together, in which order, and how the blobs between them are stored.

A *run* is a row of batchwise layers. Blobs that are read inside the run only are *hidden*: they never exist for the
whole batch. Two optimisations apply to hidden blobs, both exact:

- A blob whose writer and readers agree on it is tiled (tiles.py).
- A monotone layer in place (ReLU) before a max pooling runs after it, on a sixteenth of the values:
  max(f(a), f(b)) = f(max(a, b)), and the gradient takes the same way.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fast.fast_layer import FastLayer
from fast.traits import traits_of
from netlib.blob import Blob, Blobs
from netlib.engine.plain import Connection


@dataclass
class Run:
    """Layers to run slice by slice, or one layer to run whole.

    order   the connections as they run
    hidden  blobs that only this run reads and writes
    tiles   id of a hidden blob -> its tile
    """

    connections: list[Connection]
    order: list[Connection]
    hidden: list[Blob]
    tiles: dict[int, int]
    sliced: bool

    def outside(self, blobs: str) -> list[Blob]:
        """The whole blobs that the run reads (``"bottom"``) or writes (``"top"``)."""
        secret = {id(b) for b in self.hidden}
        return [b for at in self.connections for b in getattr(at, blobs) if id(b) not in secret]


def plan(connections: Sequence[Connection], stored: Callable[[Blob], bool]) -> list[Run]:
    """Arrange the layers of a net. Blobs for which ``stored`` is true are never hidden."""
    runs: list[Run] = []
    row: list[Connection] = []  # layers that could run in slices together
    users = {key: len(uses) for key, uses in uses_of(connections).items()}
    for at in connections:
        if _fits(row, at):
            row.append(at)
            continue
        runs += _runs_for(row, users, stored)
        row = [at] if _fits([], at) else []
        if not row:
            runs.append(whole(at))
    return runs + _runs_for(row, users, stored)


@dataclass
class Use:
    """One layer that reads or writes a blob."""

    at: Connection
    reads: bool = False
    writes: bool = False


def uses_of(connections: Sequence[Connection]) -> dict[int, list[Use]]:
    """Id of a blob -> the layers that use it, in their order."""
    uses: dict[int, list[Use]] = {}
    for at in connections:
        for half, blobs in (("reads", at.bottom), ("writes", at.top)):
            for blob in blobs:
                known = uses.setdefault(id(blob), [])
                if not known or known[-1].at is not at:
                    known.append(Use(at))
                setattr(known[-1], half, True)
    return uses


def whole(at: Connection) -> Run:
    """One layer for itself, on the whole batch."""
    return Run([at], [at], [], {}, sliced=False)


def _fits(row: list[Connection], at: Connection) -> bool:
    """May this layer join the row?"""
    if not traits_of(at.layer).batchwise or not at.bottom:
        return False
    items = {blob.shape[0] if blob.shape else None for blob in [*at.bottom, *at.top]}
    if len(items) != 1 or items == {None}:
        return False
    if not row:  # a first layer in place would change its own input, which could then not be read twice
        return all(blob is not top for blob in at.bottom for top in at.top)
    return row[0].bottom[0].shape[0] == at.bottom[0].shape[0]


def _runs_for(row: list[Connection], users: Mapping[int, int], stored: Callable[[Blob], bool]) -> list[Run]:
    """A run for the layers that could run in slices, if that gains anything. ``users`` counts those of each blob."""
    end = _end_of_run(row, users, stored)
    row, rest = row[:end], row[end:]
    hidden = _hidden_blobs(row, users, stored)
    if all(traits_of(at.layer).elementwise for at in row):  # nothing to gain; also the empty row
        return [whole(at) for at in [*row, *rest]]
    order = _pool_first(row, hidden)
    return [Run(row, order, hidden, _agree_on_tiles(order, hidden), sliced=True), *map(whole, rest)]


def _end_of_run(row: list[Connection], users: Mapping[int, int], stored: Callable[[Blob], bool]) -> int:
    """How many layers of the row may run in slices.

    A layer that overwrites a stored blob in place must not run twice (the executor may repeat a pass), unless that
    changes nothing. So the run ends before such a layer, and from it on the layers are whole. In a shorter run fewer
    blobs are hidden, only those that are unused after its end, so it may have to end earlier still.
    """
    uses = uses_of(row)
    place = {id(at): i for i, at in enumerate(row)}
    last_use: list[int] = []  # of all blobs that layers up to this one overwrite
    for at in row:
        last = last_use[-1] if last_use else -1
        if not traits_of(at.layer).monotone:
            below = {id(blob) for blob in at.bottom}
            for blob in (top for top in at.top if id(top) in below):
                own = uses[id(blob)]
                outside = len(own) < users[id(blob)] or stored(blob)
                last = max(last, len(row) if outside else place[id(own[-1].at)])
        last_use.append(last)
    end = len(row)
    while (earlier := bisect_left(last_use, end, hi=end)) < end:
        end = earlier
    return end


def _hidden_blobs(row: list[Connection], users: Mapping[int, int], stored: Callable[[Blob], bool]) -> list[Blob]:
    """Blobs that only the layers of the row read and write."""
    uses = uses_of(row)
    written = {id(blob): blob for at in row for blob in at.top}
    return [blob for key, blob in written.items() if len(uses[key]) == users[key] and not stored(blob)]


def _pool_first(row: list[Connection], hidden: list[Blob]) -> list[Connection]:
    """Move a monotone layer, in place on a hidden blob, behind the max pooling that reads it to a hidden blob."""
    secret, order = {id(b) for b in hidden}, list(row)
    for i in range(len(order) - 1):
        at, pool = order[i], order[i + 1]
        if (
            traits_of(at.layer).monotone
            and at.bottom[0] is at.top[0]
            and id(at.top[0]) in secret
            and traits_of(pool.layer).takes_maximum
            and pool.bottom[0] is at.top[0]
            and id(pool.top[0]) in secret  # else its diff would be seen with the layer's gradient in it
            and not _is_overwritten(pool.top[0], order[i + 2 :])  # backward reads the signs of what the layer wrote
        ):
            moved = Connection(at.layer, Blobs(pool.top[:1]), Blobs(pool.top[:1]), at.propagate_down, at.needs_backward)
            order[i], order[i + 1] = pool, moved
    return order


def _is_overwritten(blob: Blob, later: list[Connection]) -> bool:
    """Does a later layer in place change which values of the blob are positive?"""
    return any(top is blob and not traits_of(at.layer).monotone for at in later for top in at.top)


def _agree_on_tiles(order: list[Connection], hidden: list[Blob]) -> dict[int, int]:
    """The tile of every hidden blob for which its writer and all its readers want the same one."""
    tiles: dict[int, int] = {}
    uses = uses_of(order)
    for blob in reversed(hidden):  # readers first: what they want may depend on their own tops
        wishes = [_wish(use, tiles) for use in uses[id(blob)]]
        wanted = [wish for wish in wishes if wish != ANY]
        if wanted and wanted[0] is not None and all(wish == wanted[0] for wish in wanted):
            tiles[id(blob)] = wanted[0]
    return tiles


ANY = 0  # a layer that takes a blob in any order


def _wish(use: Use, tiles: dict[int, int]) -> int | None:
    """The layout that a layer prefers for a blob: the size of tiles, plain (None), or ``ANY``."""
    at = use.at
    if use.reads and use.writes:
        return ANY if traits_of(at.layer).elementwise else None
    if not isinstance(at.layer, FastLayer):
        return None
    if use.writes:
        return ANY if at.layer.writes_tiles() else None
    return at.layer.bottom_tile(tiles.get(id(at.top[0])) if at.top else None)
