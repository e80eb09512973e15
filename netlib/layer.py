"""The layer contract, and how a layer is made from its prototxt.

A layer has four methods, Caffe's Python-layer protocol:

    setup(bottom, top)                      once: read the options, make the parameters
    reshape(bottom, top)                    whenever a bottom's shape may have changed: shape the tops
    forward(bottom, top)                    write every top's data
    backward(top, propagate_down, bottom)   write every element of bottom[i].diff where propagate_down[i];
                                            add to the diff of the parameters

``bottom`` and ``top`` are lists of blobs. The class attributes below tell the net what it may do with a layer;
their defaults are always safe, so a layer of your own needs none of them.
"""

from __future__ import annotations

import copy
import importlib
import re
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib import schema
from netlib.blob import Blob, Blobs
from netlib.errors import LayerError, NetlibError, PrototxtError, did_you_mean
from netlib.fillers import Filler, fill
from netlib.parallel import buffer_of
from netlib.prototxt import Message
from netlib.schema import LayerParameter, Phase


@dataclass(frozen=True)
class NoParameter:
    """A layer type without options."""


@dataclass(frozen=True)
class PythonParameter:
    """The ``python_param { ... }`` block of a layer of type Python."""

    module: str  # imported from the working directory or PYTHONPATH
    layer: str  # the class
    param_str: str = ""
    share_in_parallel: bool = False


@dataclass(frozen=True)
class LossParameter:
    """The ``loss_param { ... }`` of loss layers that normalise over labels."""

    ignore_label: int | None = None  # items with this label do not count
    normalization: Literal["FULL", "VALID", "BATCH_SIZE", "NONE"] = "VALID"
    normalize: bool | None = None  # older: true is VALID, false is BATCH_SIZE


class Layer:
    """Base of all layers.

    name, type, phase   as in the prototxt; phase is netlib.TRAIN or netlib.TEST
    param               the options, an instance of ``param_type``
    param_str           the string of a Python layer's ``python_param``
    blobs               the parameters
    rng                 the source of all randomness of this layer
    """

    # What the prototxt may say
    param_type: ClassVar[type] = NoParameter  # dataclass of the options
    param_name: ClassVar[str] = ""  # their block; by default the type in snake case, ``inner_product_param``
    bottoms: ClassVar[tuple[int, int | None]] = (0, None)  # least and greatest number of bottoms; None: any
    tops: ClassVar[tuple[int, int | None]] = (0, None)
    in_place: ClassVar[bool] = True  # may a top be the same blob as its bottom
    loss_weight: ClassVar[float] = 0.0  # of the first top, unless the prototxt gives one
    is_input: ClassVar[bool] = False  # the caller writes the tops

    # What the net may do to save time. An instance may set them in setup.
    batchwise: bool = False  # item n of a top depends only on item n of the bottoms: may run on a slice of the batch;
    # such a layer reaches its parameters through self.blobs only, which is another list for every slice
    elementwise: bool = False  # every value for itself, f(0) finite: tiled blobs are welcome
    monotone: bool = False  # elementwise, non-decreasing and f(f(x)) = f(x): may as well run after a max pooling
    takes_maximum: bool = False  # a max pooling: every top value is one of the bottom values
    reads_bottom: bool = True  # backward reads bottom data
    reads_top: bool = True  # backward reads top data
    steady: bool = False  # reshape depends on the bottoms' shapes only: need not be called before each forward
    needs_backward: bool = True  # set by the net: will backward be called at all
    needs_bottom_diff: bool = True  # set by the net: will it be asked for the diff of any bottom

    def __init__(self, spec: LayerParameter, phase: Phase, rng: np.random.Generator, dtype: DTypeLike) -> None:
        self.spec = spec
        self.name, self.type, self.phase = spec.name, spec.type, PHASES[phase]
        self.rng, self.dtype = rng, np.dtype(dtype)
        self.blobs = Blobs(dtype=self.dtype)
        self.steady = spec.type != "Python"  # a Python layer may do what it likes
        options = PythonParameter if spec.type == "Python" else self.param_type
        self.param: Any = self._read_block(block_name(type(self), spec.type), options)
        self.param_str: str = self.param.param_str if spec.type == "Python" else ""
        self._buffers = threading.local()

    def _read_block(self, name: str, kind: type) -> Any:
        nothing = Message([], schema.position_of(self.spec))  # required options are then missed at the layer
        return schema.read(self.spec.blocks.get(name, nothing), kind, name)

    # ------------------------------------------------------------------------------------------ the contract

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the options and make the parameters."""

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Shape the tops for the bottoms."""
        raise NotImplementedError(f"{type(self).__name__} has no reshape")

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Write the data of the tops."""
        raise NotImplementedError(f"{type(self).__name__} has no forward")

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Write the diffs of the bottoms, add to the diffs of the parameters."""

    def allow_force_backward(self, bottom_index: int) -> bool:
        """May force_backward ask for the gradient of this bottom? Not of labels."""
        return True

    def bottom_tile(self, bottom_index: int, top_tile: int | None) -> int | None:
        """The tile in which this layer would like a bottom if its top has ``top_tile``; None: plain (see blob.py)."""
        return None

    def writes_tiles(self) -> bool:
        """Can the tops be tiled, whatever the tile?"""
        return False

    def sparse_tiles(self) -> bool:
        """Can tiled bottoms and tops be sparse?"""
        return False

    def state(self) -> dict[str, Any]:
        """What an exact resume needs besides the parameters; plain numbers and strings."""
        return {"rng": self.rng.bit_generator.state}

    def restore(self, state: dict[str, Any]) -> None:
        """Take back what ``state`` gave."""
        if "rng" in state:
            self.rng.bit_generator.state = state["rng"]

    # ------------------------------------------------------------------------------------------ for layer authors

    def new_param(self, name: str, shape: Sequence[int], filler: Filler) -> Blob:
        """Make the next parameter and fill it."""
        blob = self.blobs.add_blob(*shape)
        fill(blob.data, filler, self.rng)
        return blob

    @property
    def source(self) -> str:
        """The prototxt file that this layer is written in."""
        return schema.position_of(self.spec).source

    def fail(self, message: str, field: str | None = None) -> LayerError:
        """A LayerError that names this layer and its place in the prototxt."""
        block = self.spec.blocks.get(block_name(type(self), self.spec.type))
        where = schema.position_of(self.spec)
        if field is not None and block is not None:
            where = next((f.position for f in block.fields if f.name == field), where)
        return LayerError(f"{where}: error: layer {self.name!r}: {message}")

    def guarded(self, method: str, *args: Any) -> None:
        """Call one of the four methods; a Python error in it becomes a LayerError that names the layer."""
        try:
            getattr(self, method)(*args)
        except (NetlibError, KeyboardInterrupt, MemoryError):
            raise
        except Exception as error:
            raise self.fail(f"{method} failed: {type(error).__name__}: {error}{_place(error)}") from error

    def canonical_axis(self, axis: int, blob: Blob, what: str = "axis") -> int:
        """``axis`` counted from the front; negative ones count from the back. Raises LayerError."""
        n = len(blob.shape)
        if not -n <= axis < n:
            raise self.fail(f"{what} {axis} is out of range for a blob of {n} axes {blob.shape}", what)
        return axis % n

    def items_and_values(self, bottom: Blobs) -> tuple[int, int]:
        """The number of items and of values an item, which all bottoms must share. Raises LayerError."""
        first = bottom[0]
        items = first.shape[0] if first.shape else 0
        for other, name in zip(bottom[1:], self.spec.bottom[1:]):
            if items == 0 or other.count != first.count or other.shape[:1] != first.shape[:1]:
                raise self.fail(
                    f"bottoms {self.spec.bottom[0]!r} {first.shape} and {name!r} {other.shape} must have "
                    "the same number of items and of values an item"
                )
        return items, first.count // items

    def buffer(self, key: str, shape: tuple[int, ...], dtype: DTypeLike | None = None) -> NDArray[Any]:
        """Working memory of the calling thread: zeros at first, then whatever was left in it."""
        return buffer_of(self._buffers, key, shape, dtype or self.dtype)

    def on_slice(self, params: Blobs) -> Layer:
        """This layer for one slice of a batch: same options, parameters with diffs of their own."""
        twin = copy.copy(self)
        twin.blobs = params
        return twin


def _place(error: BaseException) -> str:
    """`` (file:line)`` of the innermost call that failed."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return f" ({Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno})" if trace else ""


PHASES: dict[str, int] = {"TRAIN": 0, "TEST": 1}  # pycaffe's caffe.TRAIN and caffe.TEST


# ---------------------------------------------------------------------------------------------- making layers


def layer_types() -> dict[str, type[Layer]]:
    """Every known layer type by name. The package ``layers`` is loaded here and nowhere else in netlib."""
    types: dict[str, type[Layer]] = importlib.import_module("layers").LAYER_TYPES
    return types


def block_name(cls: type[Layer], type_name: str) -> str:
    """Name of the options block of a layer type."""
    return (
        cls.param_name or re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", type_name).lower() + "_param"
    )


def create(spec: LayerParameter, phase: Phase, rng: np.random.Generator, dtype: DTypeLike) -> Layer:
    """Make the layer that a ``layer { ... }`` describes. Raises PrototxtError or LayerError."""
    types = layer_types()
    where = schema.position_of(spec, "type")
    if not spec.type:
        raise PrototxtError(where, f"layer {spec.name!r} has no type")
    if spec.type == "Python":
        cls = _python_class(spec)
    elif spec.type in types:
        cls = types[spec.type]
    else:
        advice = did_you_mean(spec.type, types)
        known = ", ".join(sorted([*types, "Python"]))
        raise PrototxtError(where, f"unknown layer type {spec.type!r}{advice}; known types: {known}")
    _check_blocks(spec, types)
    return cls(spec, phase, rng, dtype)


def _check_blocks(spec: LayerParameter, types: dict[str, type[Layer]]) -> None:
    """An options block must belong to some layer type; Caffe, too, ignores those of other types."""
    known = {block_name(cls, name) for name, cls in types.items()} | {"python_param", "loss_param", "transform_param"}
    tree = schema.tree_of(spec)
    for item in tree.fields if tree else []:
        if item.name in spec.blocks and item.name not in known:
            raise schema.unknown_field(item, sorted(known))


def _python_class(spec: LayerParameter) -> type[Layer]:
    block = spec.blocks.get("python_param")
    if block is None:
        raise PrototxtError(schema.position_of(spec), f"layer {spec.name!r} of type 'Python' needs a python_param")
    param = schema.read(block, PythonParameter, "python_param")
    if "" not in sys.path:
        sys.path.append("")  # the working directory, as in pycaffe
    try:
        module = importlib.import_module(param.module)
    except (Exception, SystemExit) as error:
        raise PrototxtError(
            schema.position_of(param, "module"),
            f"layer {spec.name!r}: cannot import {param.module!r} ({type(error).__name__}: {error}); "
            "it must lie in the working directory or on PYTHONPATH",
        ) from error
    cls = getattr(module, param.layer, None)
    if not (isinstance(cls, type) and issubclass(cls, Layer)):
        where = getattr(module, "__file__", param.module)
        found = f"has no such class ({where})" if cls is None else "is not a subclass of netlib.Layer"
        raise PrototxtError(
            schema.position_of(param, "layer"), f"layer {spec.name!r}: {param.module}.{param.layer} {found}"
        )
    return cls
