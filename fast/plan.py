"""Plans of nets: the layers that run slice by slice together, their order, and the storage of
blobs between them.

A *run* is a sequence of batchwise layers. Blobs that only its layers read are *unstored*: the
net does not store them. Two optimisations apply to unstored blobs, both exact:

- A blob is tiled (tiles.py) if its writer and all its readers prefer the same tile.
- A monotone layer in place (ReLU) before a max pooling is moved behind it, where it has a sixteenth
  of the values: max(f(a), f(b)) = f(max(a, b)), and the gradient is the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

from fast.fast_layer import FastLayer, is_fused
from layers.common.inner_product import InnerProduct
from netlib.blob import Blob, Blobs
from netlib.engine import Connection
from netlib.files.own_modules import NAMES
from netlib.layer import Layer

ANY = 0  # preference of a layer that supports all layouts of a blob


@dataclass
class Run:
    """Layers to run slice by slice, or one layer to run whole.

    order     the connections in execution order
    unstored  blobs that only this run reads and writes, so that they need not be stored
    tiles     the tiles of unstored blobs
    """

    connections: list[Connection]
    order: list[Connection]
    unstored: list[Blob]
    tiles: dict[Blob, int]
    sliced: bool

    @property
    def key(self) -> tuple[object, ...]:
        """What makes two runs of one net equal."""
        return *self.connections, *self.unstored, *self.tiles.items()

    def read(self) -> list[Blob]:
        """The stored blobs that the run reads."""
        return [blob for at in self.connections for blob in at.bottom if blob not in self.unstored]

    def written(self) -> list[Blob]:
        """The stored blobs that the run writes."""
        return [blob for at in self.connections for blob in at.top if blob not in self.unstored]

    def read_again(self) -> set[Blob]:
        """The blobs whose data backward reads."""
        found: set[Blob] = set()
        for at in self.order:
            if at.needs_backward:
                found.update(at.bottom if at.layer.reads_bottom else [])
                found.update([] if at.layer.reads_top is False else at.top)
        return found

    def differentiated(self) -> set[Blob]:
        """The blobs whose diffs backward computes."""
        running = [at for at in self.connections if at.needs_backward]
        return {blob for at in running for blob, down in zip(at.bottom, at.propagate_down) if down}


def plan(connections: Sequence[Connection], stored: Set[Blob]) -> list[Run]:
    """Arrange the layers of a net. Those of ``stored`` are never unstored blobs."""
    runs: list[Run] = []
    row: list[Connection] = []  # consecutive layers that could run in slices together
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
    reads: bool
    writes: bool


def uses_of(connections: Sequence[Connection]) -> dict[Blob, list[Use]]:
    """Map each blob to the layers that use it, in order."""
    uses: dict[Blob, list[Use]] = {}
    for at in connections:
        for blob in dict.fromkeys(at.blobs):
            uses.setdefault(blob, []).append(Use(at, blob in at.bottom, blob in at.top))
    return uses


def whole(at: Connection) -> Run:
    """Create a run of one layer on the whole batch."""
    return Run([at], [at], [], {}, sliced=False)


def _fits(row: list[Connection], at: Connection) -> bool:
    """Whether a layer can be appended to a row of layers that run in slices."""
    if not (at.bottom and at.layer.batchwise and _is_of_this_project(at.layer)):
        return False
    # one product for the whole batch is faster than many small ones
    if isinstance(at.layer, InnerProduct):
        return False
    items = {blob.shape[0] if blob.shape else None for blob in [*at.bottom, *at.top]}
    if len(items) != 1 or items == {None}:
        return False
    if not row:
        # a first layer in place would overwrite its input, which must remain readable
        in_place = any(blob is top for blob in at.bottom for top in at.top)
        return not in_place and not is_fused(at.layer)  # the layer that computes it runs whole
    return row[0].bottom[0].shape[0] == at.bottom[0].shape[0]


def _is_of_this_project(layer: Layer) -> bool:
    """Whether the class of a layer is one of ours.

    A user's class, such as that of a layer of type Python, may inherit ``batchwise`` from one of
    ours, or have an attribute of this name that means something else.
    """
    return layer.type != "Python" and type(layer).__module__.partition(".")[0] in NAMES


def _runs_for(row: list[Connection], users: Mapping[Blob, int], stored: Set[Blob]) -> list[Run]:
    """Plan the runs of a row of layers, in slices if this is faster.

    ``users`` is the number of users of each blob.
    """
    unstored = _unstored_blobs(row, users, stored)
    if all(at.layer.elementwise for at in row):  # slices are not faster; also the empty row
        return [whole(at) for at in row]
    order = _pool_first(row, unstored)
    tiles = _agree_on_tiles(order, unstored)
    # one slice saves no memory and copies the parameters
    if row[0].bottom[0].shape[0] == 1 and not tiles:
        return [whole(at) for at in row]
    return [Run(row, order, unstored, tiles, sliced=True)]


def _unstored_blobs(
    row: list[Connection], users: Mapping[Blob, int], stored: Set[Blob]
) -> list[Blob]:
    """Blobs that only the layers of the row read and write."""
    uses = uses_of(row)
    written = dict.fromkeys(blob for at in row for blob in at.top)
    return [blob for blob in written if len(uses[blob]) == users[blob] and blob not in stored]


def _pool_first(row: list[Connection], unstored: list[Blob]) -> list[Connection]:
    """Move a monotone layer, in place on an unstored blob, behind the max pooling that reads it to
    an unstored blob.
    """
    order = list(row)
    for i in range(len(order) - 1):
        at, pool = order[i], order[i + 1]
        # backward reads the signs of the layer's output
        if not _may_follow(at, pool, unstored) or _is_overwritten(pool.top[0], order[i + 2 :]):
            continue
        blobs = Blobs(pool.top[:1])
        moved = Connection(at.layer, blobs, blobs, at.propagate_down, at.needs_backward)
        order[i], order[i + 1] = pool, moved
    return order


def _may_follow(at: Connection, pool: Connection, unstored: list[Blob]) -> bool:
    """Whether ``at`` is a monotone layer in place on an unstored blob, and ``pool`` the max pooling
    that reads it.
    """
    blob = at.top[0]
    if at.bottom[0] is not blob or pool.bottom[0] is not blob or blob not in unstored:
        return False
    if pool.top[0] not in unstored:  # a caller would find the wrong gradient in its diff
        return False
    takes_maximum = isinstance(pool.layer, FastLayer) and pool.layer.takes_maximum()
    return _is_monotone(at.layer) and takes_maximum


def _is_monotone(layer: Layer) -> bool:
    return isinstance(layer, FastLayer) and layer.is_monotone()


def _is_overwritten(blob: Blob, later: list[Connection]) -> bool:
    """Whether a later layer in place changes which values of the blob are positive."""
    return any(top is blob and not _is_monotone(at.layer) for at in later for top in at.top)


def _agree_on_tiles(order: list[Connection], unstored: list[Blob]) -> dict[Blob, int]:
    """Map unstored blobs to their tiles; a blob is tiled if its writer and all its readers prefer
    the same tile.
    """
    tiles: dict[Blob, int] = {}
    uses = uses_of(order)
    # readers first, because their preference may depend on their tops
    for blob in reversed(unstored):
        preferred = {_preference(use, tiles) for use in uses[blob]} - {ANY}
        tile = preferred.pop() if len(preferred) == 1 else None
        if tile is not None:
            tiles[blob] = tile
    return tiles


def _preference(use: Use, tiles: dict[Blob, int]) -> int | None:
    """The layout that is fastest for a layer: the size of tiles, plain (None), or ``ANY``."""
    at = use.at
    if use.reads and use.writes:
        return ANY if at.layer.elementwise else None
    if not isinstance(at.layer, FastLayer):
        return None
    if use.writes:
        return ANY if at.layer.writes_tiles() else None
    return at.layer.bottom_tile(tiles.get(at.top[0]) if at.top else None)
