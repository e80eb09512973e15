"""Blob: an array and its gradient, ``data`` and ``diff``, of one shape.

Memory is taken when somebody first looks, so a blob that nobody reads costs nothing.

A blob inside a slice of the batch (slices.py) may be *tiled*: its arrays then have the shape
``(R, T, C, N, P)`` instead of ``(N, C, H, W)``, and hold the value of row h, column w, channel c, image n at
``[h, w % T, c, n, w // T]``. R is H rounded up to a multiple of T; P columns are stored a phase, at least
W / T. This is the order in which a convolution by matrix products writes and a T x T max pooling reads, both
in long contiguous runs (see layers/convolution.py). The padding in ``data`` is any finite number, in
``diff`` it is zero. Only layers that say that they can handle tiles are ever given such a blob.

A tiled blob that one layer writes and one reads may be *sparse* (``Blob.sparse``): only some of its T x T windows
are stored, because all others hold one and the same value for each channel, as over the background of a depth image.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

Array = NDArray[Any]


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


class Blob:
    """Values and gradients that layers hand to each other, and parameters.

    shape    of data and diff
    data     values
    diff     dL/d(data)
    tile     None, or T if the arrays are tiled (see the module)
    pitch    columns stored a row if tiled, T * P
    sparse   None, or the windows that are stored, instead of ``data`` and ``diff``
    """

    tile: int | None = None
    pitch: int = 0
    may_be_sparse: bool = False
    lazily_cleared: bool = False  # every layer that adds to this parameter's diff asks ``diff_to_add_to``
    sparse: SparseTiles | None = None
    _on_look: Callable[[], None] | None = None  # called before the first look at a blob that is not stored

    def __init__(self, shape: Iterable[int] = (), dtype: DTypeLike = np.float32) -> None:
        self.dtype = np.dtype(dtype)
        self._shape = tuple(int(n) for n in shape)
        self._data: Array | None = None
        self._diff: Array | None = None
        self._owner: Blob | None = None
        self._diff_is_clear = False  # reads as zeros, but the memory still has to be filled with them

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the axes."""
        return self._shape

    @property
    def count(self) -> int:
        """Number of values."""
        n = 1
        for size in self._shape:
            n *= size
        return n

    def reshape(self, *shape: Any) -> None:
        """Change the shape: ``reshape(2, 3)`` or ``reshape((2, 3))``. A new shape forgets the values."""
        if len(shape) == 1 and not np.isscalar(shape[0]):
            shape = tuple(shape[0])
        shape = tuple(int(n) for n in shape)
        if shape != self._shape:
            if min(shape, default=0) < 0:
                raise ValueError(f"a blob cannot have the shape {shape}")
            self._shape = shape
            self._data = self._diff = None

    def share(self, owner: Blob) -> None:
        """Use the memory of ``owner``, data and diff, in this blob's own shape (of the same count)."""
        self._owner, self._data, self._diff = owner, None, None

    def adopt(self, data: Array) -> None:
        """Make ``data`` the blob's data, without a copy."""
        if data.shape != self.storage_shape or data.dtype != self.dtype:
            raise ValueError(
                f"expected an array {self.storage_shape} of {self.dtype}, not {data.shape} of {data.dtype}"
            )
        self._data = data

    @property
    def storage_shape(self) -> tuple[int, ...]:
        """Shape of the arrays: ``shape``, or (R, T, C, N, P) if tiled."""
        if self.tile is None:
            return self._shape
        (N, C, H, _), T = self._shape, self.tile
        return (-(-H // T) * T, T, C, N, self.pitch // T)

    @property
    def data(self) -> Array:
        """Values, of ``storage_shape``."""
        if self._owner is not None:
            return self._owner.data.reshape(self._shape)
        if self._on_look is not None:
            self._on_look()
        if self._data is None:
            self._data = np.zeros(self.storage_shape, self.dtype)
        return self._data

    def ensure(self, half: Literal["data", "diff"]) -> None:
        """Take the memory of ``data`` or ``diff`` now."""
        getattr(self, half)

    @property
    def diff(self) -> Array:
        """Gradient of the loss at the values, of ``storage_shape``."""
        if self._owner is not None:
            return self._owner.diff.reshape(self._shape)
        if self._on_look is not None:
            self._on_look()
        if self._diff is None:
            self._diff = np.zeros(self.storage_shape, self.dtype)
        elif self._diff_is_clear:
            self._diff.fill(0)
        self._diff_is_clear = False
        return self._diff

    def clear_diff(self) -> None:
        """Set the diff to zero, at once or, for a parameter of ``lazily_cleared``, when somebody looks at ``diff``."""
        root = self._root()
        if root.lazily_cleared:
            root._diff_is_clear = True
        else:
            self.diff.fill(0)

    def diff_to_add_to(self) -> tuple[Array, bool]:
        """The diff, and whether it is known to be zero: then its memory holds anything, and all of it must be written.

        That spares filling a large gradient with zeros, reading it again and adding to it.
        """
        root = self._root()
        clear, root._diff_is_clear = root._diff_is_clear, False
        return self.diff, clear

    def _root(self) -> Blob:
        """Whose memory this is."""
        return self if self._owner is None else self._owner._root()

    # Caffe's names for the first axes
    @property
    def num(self) -> int:
        """Size of axis 0, 1 if there is none."""
        return self._axis(0)

    @property
    def channels(self) -> int:
        """Size of axis 1, 1 if there is none."""
        return self._axis(1)

    @property
    def height(self) -> int:
        """Size of axis 2, 1 if there is none."""
        return self._axis(2)

    @property
    def width(self) -> int:
        """Size of axis 3, 1 if there is none."""
        return self._axis(3)

    def _axis(self, i: int) -> int:
        return self._shape[i] if i < len(self._shape) else 1

    def __repr__(self) -> str:
        return f"<Blob {'x'.join(map(str, self._shape)) or 'scalar'} {self.dtype}>"


class Blobs(list[Blob]):
    """A list of blobs; ``add_blob`` is how a Caffe Python layer makes a parameter."""

    def __init__(self, blobs: Iterable[Blob] = (), dtype: DTypeLike = np.float32) -> None:
        super().__init__(blobs)
        self.dtype = np.dtype(dtype)

    def add_blob(self, *shape: int) -> Blob:
        """Append a blob of zeros and return it."""
        self.append(Blob(shape, self.dtype))
        return self[-1]


def tiles_of(blob: Blob, array: Array, tile: int, pitch: int, out: Array) -> Array:
    """``array`` (a data or diff of ``blob``) as tiles of ``tile``: itself, or copied into ``out``.

    ``out`` has the storage shape of such tiles; its padding is left alone.
    """
    if blob.tile == tile and blob.pitch == pitch:
        return array
    H = blob.shape[2]
    plain = plain_of(blob, array)
    for phase in range(tile):
        columns = plain[..., phase::tile]
        out[:H, phase, ..., : columns.shape[-1]] = columns.transpose(2, 1, 0, 3)
    return out


def plain_of(blob: Blob, array: Array) -> Array:
    """``array`` (a data or diff of ``blob``) as (N, C, H, W): itself, a view or a copy."""
    if blob.tile is None:
        return array
    return untile(array, *blob.shape[2:])


def untile(array: Array, H: int, W: int) -> Array:
    """Tiles (R, T, C, N, P) → (N, C, H, W), a view where T is 1, else a copy."""
    _, T, C, N, P = array.shape
    return array[:H].transpose(3, 2, 0, 4, 1).reshape(N, C, H, P * T)[..., :W]
