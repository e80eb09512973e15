"""Blob: an array (``data``) and its gradient (``diff``), both of one shape; blocks of an array.

Layers exchange blobs and keep their parameters in blobs. Memory is allocated at the first access,
so an unused gradient takes no memory.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib.errors import NetlibError
from netlib.system import memory
from netlib.system.memory import OutOfMemoryError

Array = NDArray[Any]
Zeros = Callable[[tuple[int, ...], DTypeLike], Array]  # allocates the array of a blob
MAX_AXES = 32  # same limit as Caffe


@dataclass
class Memory:
    """The arrays of a blob ("data", "diff"), all of one shape.

    A reshape replaces the whole object, and an array is added at most once, so several threads
    may read a blob.
    """

    shape: tuple[int, ...]
    arrays: dict[str, Array] = field(default_factory=dict)


class Blob:
    """An array and the gradient of the loss with respect to it.

    shape          shape of both arrays
    data           values
    diff           dL/d(data)
    version        another number after each change of the shape, and after ``data`` became those of
                   another blob
    on_access      while a net does not store the blob, or computes such a blob from it: called with
                   the blob and "data" or "diff" before each access, and "memory" before the memory
                   of the data is replaced, or shared
    keeps_first    whether a reshape to a smaller count keeps the first values, as it does in Caffe:
                   that of an input, which a caller may write before the reshape
    is_held        whether a caller may have an array of the data, by which it can be written

    Engines have no subclass for the blobs of a net: scripts of pycaffe compare ``type(blob)`` with
    this class. Another thread may read a blob while a net reshapes it; it gets an array of the old
    or of the new shape.
    """

    on_access: Callable[[Blob, str], None] | None = None
    keeps_first = False

    def __init__(
        self, shape: Iterable[int] = (), dtype: DTypeLike = np.float32, zeros: Zeros = memory.zeros
    ) -> None:
        self.dtype, self._zeros, self.version = np.dtype(dtype), zeros, 0
        self._memory = Memory(self._checked(tuple(map(int, shape))))
        # "data", "diff" -> the blob whose memory holds it, if not this one
        self._owners: dict[str, Blob] = {}

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the axes."""
        return self._memory.shape

    @property
    def count(self) -> int:
        """Number of values."""
        return math.prod(self._memory.shape)

    @property
    def bytes(self) -> int:
        """Size in bytes of ``data``, and of ``diff``."""
        return self.count * self.dtype.itemsize

    @property
    def allocated_bytes(self) -> int:
        """Size in bytes of the arrays that have been accessed, without those of other blobs."""
        return sum(array.nbytes for array in self._memory.arrays.values())

    @property
    def owns_memory(self) -> bool:
        """Whether ``data`` is this blob's own memory, not shared from another blob."""
        return "data" not in self._owners

    @property
    def data(self) -> Array:
        """The values: at each access another array of this memory, whose own shape and flags
        may be changed.
        """
        return self._values("data")

    @property
    def is_held(self) -> bool:
        """Whether an array of this memory is in use outside of the blob, which the number of
        references to it shows, or the memory is that of another blob.
        """
        if not self.owns_memory or not COUNTS_REFERENCES:
            return True
        if "data" not in self._memory.arrays:
            return False
        # counted at the same moment, because a debugger adds references
        return self._references() not in [blob._references() for blob in UNHELD]

    def _references(self) -> tuple[int, int]:
        """The number of references to the array of the data, and to the one that it views."""
        array = self._memory.arrays["data"]
        viewed = 0 if array.base is None else sys.getrefcount(array.base)
        return sys.getrefcount(array), viewed

    @property
    def diff(self) -> Array:
        """Gradient of the loss with respect to the values; an array as for ``data``."""
        return self._values("diff")

    @property
    def unwatched_data(self) -> Array:
        """The values, without a call of ``on_access``."""
        return self._in_this_shape(self.root._array("data"))

    @property
    def root(self) -> Blob:
        """The blob whose memory holds the data: this one, or the one that it shares."""
        root = self
        while "data" in root._owners:
            root = root._owners["data"]
        return root

    def _values(self, half: str) -> Array:
        """An array of this name, of the owner's memory if it has one."""
        if self.on_access is not None:
            self.on_access(self, half)
        owner = self._owners.get(half)
        if owner is None:
            return self._array(half).view()
        return self._in_this_shape(owner._values(half))

    def _array(self, half: str) -> Array:
        """The own array of this name, of zeros if it is new."""
        memory = self._memory
        array = memory.arrays.get(half)
        if array is None:
            array = memory.arrays.setdefault(half, self._zeros(memory.shape, self.dtype))
        return array

    def _in_this_shape(self, array: Array) -> Array:
        """An array of another blob in this shape.

        Raises NetlibError if that blob has another count now.
        """
        if array.size != self.count:
            raise NetlibError(
                f"a blob of shape {self.shape} shares the memory of another, which was reshaped to {array.shape}: "
                "call net.reshape() or run forward"
            )
        return array.reshape(self.shape)

    def reshape(self, *shape: Any) -> None:
        """Change the shape: ``reshape(2, 3)`` or ``reshape((2, 3))``.

        A new count discards the values, unless ``keeps_first`` and it is smaller.
        """
        if len(shape) == 1 and not np.isscalar(shape[0]):
            shape = tuple(shape[0])
        shape = tuple(map(int, shape))
        if shape != self.shape:
            self._checked(shape)
            if self.on_access is not None:
                self.on_access(self, "memory")
            self.version += 1
            count = math.prod(shape)
            is_kept = count == self.count or (self.keeps_first and count < self.count)
            kept = self._memory.arrays if is_kept else {}
            self._memory = Memory(
                shape, {half: array.ravel()[:count].reshape(shape) for half, array in kept.items()}
            )

    def _checked(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Return ``shape``. Raises ValueError or OutOfMemoryError if no array can have it."""
        if min(shape, default=0) < 0 or len(shape) > MAX_AXES:
            raise ValueError(f"a blob cannot have the shape {shape}")
        if math.prod(n for n in shape if n) * self.dtype.itemsize >= 2**63:
            raise OutOfMemoryError(
                f"a blob cannot have the shape {shape}: no computer has so much memory"
            )
        return shape

    def share(self, owner: Blob) -> None:
        """Share the data and diff of ``owner``, viewed in this blob's shape.

        The counts must be equal.
        """
        self._share("data", owner)
        self._share("diff", owner)

    def share_data(self, owner: Blob) -> None:
        """Share the data of ``owner``, viewed in this blob's shape. The diff stays separate."""
        self._share("data", owner)

    def _share(self, half: str, owner: Blob) -> None:
        while half in owner._owners:
            owner = owner._owners[half]
        if owner is not self and owner is not self._owners.get(half):
            if half == "data":
                for blob in (self, owner):
                    if blob.on_access is not None:
                        blob.on_access(blob, "memory")
                self.version += 1
            self._owners[half] = owner
            self._memory.arrays.pop(half, None)

    def copy_data(self, other: Blob) -> None:
        """Copy the data of another blob. Raises NetlibError if it has another count now."""
        self.data[...] = self._in_this_shape(other.data)

    def unshare_data(self) -> None:
        """Keep the data in memory of this blob, with the same values; unless those of the owner
        have been discarded.
        """
        if "data" in self._owners and self._owners["data"].count == self.count:
            own = self._zeros(self.shape, self.dtype)
            own[...] = self.data
            self._memory.arrays["data"] = own
            del self._owners["data"]

    def keep(self, **arrays: Array) -> None:
        """Use arrays as own memory, ``keep(data=..., diff=...)``, as if they had been written
        before the last reshape: they are discarded if their count is another one.
        """
        if all(array.size == self.count for array in arrays.values()):
            own = {half: array.reshape(self.shape) for half, array in arrays.items()}
            self._memory = Memory(self.shape, self._memory.arrays | own)

    # Caffe's names for the first four axes
    @property
    def num(self) -> int:
        """Size of axis 0, or 1 if there is none."""
        return self._axis(0)

    @property
    def channels(self) -> int:
        """Size of axis 1, or 1 if there is none."""
        return self._axis(1)

    @property
    def height(self) -> int:
        """Size of axis 2, or 1 if there is none."""
        return self._axis(2)

    @property
    def width(self) -> int:
        """Size of axis 3, or 1 if there is none."""
        return self._axis(3)

    def _axis(self, i: int) -> int:
        return self.shape[i] if i < len(self.shape) else 1

    def __repr__(self) -> str:
        return f"<Blob {'x'.join(map(str, self.shape)) or 'scalar'} {self.dtype}>"


# blobs whose arrays nothing uses: one that owns its memory, and one within other memory
UNHELD = Blob((1,), zeros=np.zeros), Blob((1,), zeros=lambda _, dtype: np.zeros(2, dtype)[1:])
for _blob in UNHELD:
    _blob.data  # noqa: B018 - allocates
# not without the interpreter lock, where counts may be late
COUNTS_REFERENCES = hasattr(sys, "getrefcount") and getattr(sys, "_is_gil_enabled", lambda: True)()


class Blobs(list[Blob]):
    """A list of blobs. Caffe's Python layers create parameters with ``add_blob``.

    bytes_before  size in bytes of the parameters that the net had before this layer
    """

    def __init__(self, blobs: Iterable[Blob] = (), dtype: DTypeLike = np.float32) -> None:
        super().__init__(blobs)
        self.dtype = np.dtype(dtype)
        self.bytes_before = 0

    def add_blob(self, *shape: int) -> Blob:
        """Append a blob of zeros and return it.

        Raises OutOfMemoryError if it does not fit in memory.
        """
        blob = Blob(shape, self.dtype)
        memory.check(
            blob.bytes + sum(other.bytes for other in self) + self.bytes_before, "of parameters"
        )
        self.append(blob)
        return blob


class BlobVec(Blobs):
    """The parameters of a layer: ``net.params["fc"][0] = blob`` lets the parameter share the
    memory of the blob.
    """

    def __setitem__(self, index: Any, blob: Any) -> None:
        own = self[index]  # layers keep it
        if (own.count, own.dtype) != (blob.count, blob.dtype):
            raise ValueError(
                f"{blob} cannot take the place of {own}: expected as many values of the same type"
            )
        own.share(blob)


def blocks(count: int, size: int) -> list[slice]:
    """Split ``range(count)`` into slices of ``size``, the last one shorter, for processing an array
    in parts.
    """
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


def divide_up(count: int, size: int) -> int:
    """Divide and round up: the number of blocks of ``size`` in ``count``."""
    return -(-count // size)
