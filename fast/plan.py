"""Which layers of a net run slice by slice together, in which order, and how the blobs between them are stored.

A *run* is a row of batchwise layers. Of its blobs, those that nobody else reads are *hidden*: they never exist for the
whole batch. Two freedoms are used on hidden blobs, both exact:

- A blob whose writer and readers agree on it is tiled (tiles.py).
- A monotone layer in place (ReLU) before a max pooling runs after it, on a sixteenth of the values:
  max(f(a), f(b)) = f(max(a, b)), and the gradient takes the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fast.facts import facts_of
from fast.twin import Twin
from netlib.blob import Blob, Blobs
from netlib.plain import Connection


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
    for at in connections:
        if _fits(row, at):
            row.append(at)
            continue
        runs += _runs_for(row, connections, stored)
        row = [at] if _fits([], at) else []
        if not row:
            runs.append(whole(at))
    return runs + _runs_for(row, connections, stored)


def whole(at: Connection) -> Run:
    """One layer for itself, on the whole batch."""
    return Run([at], [at], [], {}, sliced=False)


def _fits(row: list[Connection], at: Connection) -> bool:
    """May this layer join the row?"""
    if not facts_of(at.layer).batchwise or not at.bottom:
        return False
    items = {blob.shape[0] if blob.shape else None for blob in [*at.bottom, *at.top]}
    if len(items) != 1 or items == {None}:
        return False
    if not row:  # a first layer in place would change its own input, which could then not be read twice
        return all(blob is not top for blob in at.bottom for top in at.top)
    return row[0].bottom[0].shape[0] == at.bottom[0].shape[0]


def _runs_for(row: list[Connection], connections: Sequence[Connection], stored: Callable[[Blob], bool]) -> list[Run]:
    """A run for the layers that could run in slices, if that gains anything.

    A layer that overwrites a stored blob in place must not run twice (the executor may repeat a pass), unless that
    changes nothing. So the run ends before such a layer, and from it on the layers are whole. In a shorter run fewer
    blobs are hidden, so it is looked at again.
    """
    rest: list[Connection] = []
    while True:
        hidden = _hidden_blobs(row, connections, stored)
        end = next((i for i, at in enumerate(row) if _overwrites(at, hidden) and not facts_of(at.layer).monotone), None)
        if end is None:
            break
        row, rest = row[:end], row[end:] + rest
    if all(facts_of(at.layer).elementwise for at in row):  # nothing to gain; also the empty row
        return [whole(at) for at in [*row, *rest]]
    order = _pool_first(row, hidden)
    return [Run(row, order, hidden, _agree_on_tiles(order, hidden), sliced=True), *map(whole, rest)]


def _hidden_blobs(
    row: list[Connection], connections: Sequence[Connection], stored: Callable[[Blob], bool]
) -> list[Blob]:
    """Blobs that only the layers of the row read and write."""
    inside = {id(at) for at in row}
    written = {id(blob): blob for at in row for blob in at.top}
    elsewhere = {id(blob) for at in connections if id(at) not in inside for blob in [*at.bottom, *at.top]}
    return [blob for key, blob in written.items() if key not in elsewhere and not stored(blob)]


def _overwrites(at: Connection, hidden: list[Blob]) -> bool:
    """Does the layer run in place on a blob that is stored?"""
    secret = {id(blob) for blob in hidden}
    return any(blob is top and id(blob) not in secret for blob in at.bottom for top in at.top)


def _pool_first(row: list[Connection], hidden: list[Blob]) -> list[Connection]:
    """Move a monotone layer, in place on a hidden blob, behind the max pooling that reads it to a hidden blob."""
    secret, order = {id(b) for b in hidden}, list(row)
    for i in range(len(order) - 1):
        at, pool = order[i], order[i + 1]
        if (
            facts_of(at.layer).monotone
            and at.bottom[0] is at.top[0]
            and id(at.top[0]) in secret
            and facts_of(pool.layer).takes_maximum
            and pool.bottom[0] is at.top[0]
            and id(pool.top[0]) in secret  # else its diff would be seen with the layer's gradient in it
        ):
            moved = Connection(at.layer, Blobs(pool.top[:1]), Blobs(pool.top[:1]), at.propagate_down, at.needs_backward)
            order[i], order[i + 1] = pool, moved
    return order


def _agree_on_tiles(order: list[Connection], hidden: list[Blob]) -> dict[int, int]:
    """The tile of every hidden blob for which its writer and all its readers want the same one."""
    tiles: dict[int, int] = {}
    for blob in reversed(hidden):  # readers first: what they want may depend on their own tops
        wishes = [_wish(at, blob, tiles) for at in order if any(b is blob for b in [*at.bottom, *at.top])]
        wanted = [wish for wish in wishes if wish != ANY]
        if wanted and wanted[0] is not None and all(wish == wanted[0] for wish in wanted):
            tiles[id(blob)] = wanted[0]
    return tiles


ANY = 0  # a layer that takes a blob in any order


def _wish(at: Connection, blob: Blob, tiles: dict[int, int]) -> int | None:
    """How a layer would like a blob that it reads or writes: in tiles of so many, plain (None), or ``ANY``."""
    reads, writes = (any(b is blob for b in blobs) for blobs in (at.bottom, at.top))
    if reads and writes:
        return ANY if facts_of(at.layer).elementwise else None
    if not isinstance(at.layer, Twin):
        return None
    if writes:
        return ANY if at.layer.writes_tiles() else None
    return at.layer.bottom_tile(tiles.get(id(at.top[0])) if at.top else None)
