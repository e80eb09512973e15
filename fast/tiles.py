"""Blobs in tiles, of which only some may be stored.

A blob inside a slice of the batch (slices.py) may be *tiled*: its arrays then have the shape
``(R, T, C, N, P)`` instead of ``(N, C, H, W)``, and the value of row h, column w, channel c, image
n is at ``[h, w % T, c, n, w // T]``. R is H rounded up to a multiple of T; P columns are stored
per phase, at least W / T. This is the order in which a convolution by matrix products writes and a
T x T max pooling reads, both in long contiguous blocks (row_tiles.py). The padding in
``data`` is any finite number, in ``diff`` it is zero. Only layers that declare support for tiles
get such a blob.

A tiled blob that one layer writes and one layer reads may be *sparse*: only some of its T x T
windows are stored. In all others, such as those over the background of a depth image, each channel
has one constant value.
"""

from __future__ import annotations

from dataclasses import dataclass

from netlib.blob import Array, Blob, divide_up


@dataclass
class SparseTiles:
    """The A stored windows of a sparse blob.

    window               (A,) their indices among all windows, row by row, images one
                         after the other
    values               (T T, C, A) data without the bias, for each element of the windows; valid
                         until the next slice
    bias                 (C,) to be added to values; a max pooling adds it only to the maximum
    rest                 (C,) data of all other windows, including the bias
    diff, winner         (C, A) diff of the only element of a window that has one, and its
                         index in the window
    rest_diff            (C,) sum of the diffs of all other windows
    """

    window: Array
    values: Array
    bias: Array
    rest: Array
    diff: Array | None = None
    winner: Array | None = None
    rest_diff: Array | None = None


class FastBlob(Blob):
    """A blob of one slice, which may be tiled.

    tile           T if the arrays are tiled (see the module), else None
    pitch          columns stored per row if tiled, T * P
    may_be_sparse  whether both users of a tiled blob support sparse windows
    sparse         the stored windows, which replace ``data`` and ``diff``, or None
    """

    tile: int | None = None
    pitch: int = 0
    may_be_sparse: bool = False
    sparse: SparseTiles | None = None

    @property
    def storage_shape(self) -> tuple[int, ...]:
        """Shape of the arrays: ``shape``, or (R, T, C, N, P) if tiled."""
        if self.tile is None:
            return self.shape
        return tiled_shape(self.shape, self.tile, self.pitch)


def tiled_shape(shape: tuple[int, ...], tile: int, pitch: int) -> tuple[int, ...]:
    """The shape (R, T, C, N, P) of tiles for a blob (N, C, H, W) with ``pitch`` columns a row."""
    N, C, H, _ = shape
    return divide_up(H, tile) * tile, tile, C, N, pitch // tile


def tile_of(blob: Blob) -> int | None:
    """T of a tiled blob, None for other blobs."""
    return blob.tile if isinstance(blob, FastBlob) else None


def pitch_of(blob: Blob) -> int:
    """Number of columns stored per row of a tiled blob, 0 for other blobs."""
    return blob.pitch if isinstance(blob, FastBlob) else 0


def sparse_of(blob: Blob) -> SparseTiles | None:
    """The windows of a sparse blob, None for other blobs."""
    return blob.sparse if isinstance(blob, FastBlob) else None


def tiles_of(blob: Blob, array: Array, tile: int, pitch: int, out: Array) -> Array:
    """Return ``array``, the data or diff of ``blob``, as tiles of ``tile``: itself, or
    copied into ``out``.

    ``out`` has the storage shape of such tiles; its padding becomes zero.
    """
    if tile_of(blob) == tile and pitch_of(blob) == pitch:
        return array
    return tile_into(plain_of(blob, array), tile, out)


def plain_of(blob: Blob, array: Array) -> Array:
    """Return ``array``, the data or diff of ``blob``, as (N, C, H, W)."""
    return array if tile_of(blob) is None else untile(array, *blob.shape[2:])


def store_plain(blob: Blob, plain: Array, out: Array) -> None:
    """Write ``plain`` (N, C, H, W) to ``out``, the data or diff of ``blob``, as tiles
    if it is tiled.
    """
    tile = tile_of(blob)
    if tile is None:
        out[...] = plain
    else:
        tile_into(plain, tile, out)


def tile_into(plain: Array, tile: int, out: Array) -> Array:
    """Convert (N, C, H, W) to tiles, written to ``out``; its padding is set to zero.

    Without that, the padding could have values of an image of another size whose tiles have
    the same shape.
    """
    H = plain.shape[2]
    for phase in range(tile):
        columns = plain[..., phase::tile]
        out[:H, phase, ..., : columns.shape[-1]] = columns.transpose(2, 1, 0, 3)
        out[:H, phase, ..., columns.shape[-1] :] = 0
    out[H:] = 0
    return out


def untile(array: Array, H: int, W: int) -> Array:
    """Convert tiles (R, T, C, N, P) to (N, C, H, W); a view if T is 1, else a copy."""
    _, T, C, N, P = array.shape
    plain = array[:H].transpose(3, 2, 0, 4, 1).reshape(N, C, H, P * T)
    return plain[..., :W]
