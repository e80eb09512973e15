"""Blobs of the fast engine: tiled, sparse, and accessed by the caller.

A blob inside a slice of the batch (slices.py) may be *tiled*: its arrays then have the shape
``(R, T, C, N, P)`` instead of ``(N, C, H, W)``, and hold the value of row h, column w, channel c, image n at
``[h, w % T, c, n, w // T]``. R is H rounded up to a multiple of T; P columns are stored per phase, at least
W / T. This is the order in which a convolution by matrix products writes and a T x T max pooling reads, both
in long contiguous runs (row_tiles.py). The padding in ``data`` is any finite number, in ``diff`` it is zero.
Only layers that declare support for tiles get such a blob.

A tiled blob that one layer writes and one reads may be *sparse*: only some of its T x T windows are stored, because
all others hold one and the same value for each channel, as over the background of a depth image.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from netlib.blob import Array, Blob


@dataclass
class SparseTiles:
    """The windows of a sparse blob, A of them.

    window               (A,) which they are: all windows of an image counted row by row, images one after the other
    values               (T T, C, A) data without the bias, place by place of the window; good until the next slice
    bias                 (C,) to be added to values: by a max pooling to the one of T T that it keeps
    rest                 (C,) data everywhere else, with the bias
    diff, winner         (C, A): of a window only the place that won has a diff, which of the T T is ``winner``
    rest_diff            (C,) the diffs of everything else, summed
    """

    window: Array
    values: Array
    bias: Array
    rest: Array
    diff: Array | None = None
    winner: Array | None = None
    rest_diff: Array | None = None


class FastBlob(Blob):
    """A blob of a net, or of one slice.

    tile           None, or T if the arrays are tiled (see the module)
    pitch          columns stored per row if tiled, T * P
    may_be_sparse  both users of a tiled blob can handle sparse windows
    sparse         None, or the windows that are stored, instead of ``data`` and ``diff``
    on_look        called before the first look at data or diff
    on_look_data   called before the first look at data
    """

    tile: int | None = None
    pitch: int = 0
    may_be_sparse: bool = False
    sparse: SparseTiles | None = None
    on_look: Callable[[], None] | None = None
    on_look_data: Callable[[], None] | None = None

    @property
    def storage_shape(self) -> tuple[int, ...]:
        """Shape of the arrays: ``shape``, or (R, T, C, N, P) if tiled."""
        if self.tile is None:
            return self._shape
        (N, C, H, _), T = self._shape, self.tile
        return (-(-H // T) * T, T, C, N, self.pitch // T)

    @property
    def data(self) -> Array:
        """Values."""
        while self.on_look is not None:  # a hidden blob is first stored, and then copied
            self.on_look()
        if self.on_look_data is not None:
            self.on_look_data()
        return super().data if self._data is None else self._data  # a call less: one image looks 60 times

    @property
    def diff(self) -> Array:
        """Gradient of the loss at the values."""
        while self.on_look is not None:
            self.on_look()
        return super().diff if self._diff is None else self._diff

    def copies(self, of_diff: bool) -> tuple[Array | None, Array | None]:
        """Copies of data, and of diff if that is wanted; None where there is no memory for them yet."""
        data, diff = self._data, self._diff if of_diff else None
        return None if data is None else data.copy(), None if diff is None else diff.copy()

    def adopt(self, data: Array) -> None:
        """Make ``data`` the blob's data, without a copy."""
        if data.shape != self._shape or data.dtype != self.dtype:
            raise ValueError(f"expected an array {self._shape} of {self.dtype}, not {data.shape} of {data.dtype}")
        self._data = data


def tile_of(blob: Blob) -> int | None:
    """T of a tiled blob, None of any other."""
    return blob.tile if isinstance(blob, FastBlob) else None


def pitch_of(blob: Blob) -> int:
    """Columns stored per row of a tiled blob, 0 of any other."""
    return blob.pitch if isinstance(blob, FastBlob) else 0


def sparse_of(blob: Blob) -> SparseTiles | None:
    """The windows of a sparse blob, None of any other."""
    return blob.sparse if isinstance(blob, FastBlob) else None


def tiles_of(blob: Blob, array: Array, tile: int, pitch: int, out: Array) -> Array:
    """``array`` (a data or diff of ``blob``) as tiles of ``tile``: itself, or copied into ``out``.

    ``out`` has the storage shape of such tiles; its padding becomes zero.
    """
    if tile_of(blob) == tile and pitch_of(blob) == pitch:
        return array
    plain = array if tile_of(blob) is None else untile(array, *blob.shape[2:])
    return tile_into(plain, tile, out)


def tile_into(plain: Array, tile: int, out: Array) -> Array:
    """(N, C, H, W) → tiles, written into ``out``; its padding becomes zero.

    The memory may hold an image of another size whose tiles have the same shape.
    """
    H = plain.shape[2]
    for phase in range(tile):
        columns = plain[..., phase::tile]
        out[:H, phase, ..., : columns.shape[-1]] = columns.transpose(2, 1, 0, 3)
        out[:H, phase, ..., columns.shape[-1] :] = 0
    out[H:] = 0
    return out


def untile(array: Array, H: int, W: int) -> Array:
    """Tiles (R, T, C, N, P) → (N, C, H, W), a view where T is 1, else a copy."""
    _, T, C, N, P = array.shape
    return array[:H].transpose(3, 2, 0, 4, 1).reshape(N, C, H, P * T)[..., :W]
