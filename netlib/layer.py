"""The layer contract.

A layer has four methods, Caffe's Python-layer protocol:

    setup(bottom, top)                      once: read the options, make the parameters
    reshape(bottom, top)                    before each forward: shape the tops
    forward(bottom, top)                    write every top's data
    backward(top, propagate_down, bottom)   write every element of bottom[i].diff where
                                            propagate_down[i]; add to the diff of the parameters

``bottom`` and ``top`` are lists of blobs. The class attributes declare which options and blobs a
prototxt may give a layer type; a layer of your own needs none of them.
"""

from __future__ import annotations

import difflib
import inspect
import logging
import sys
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import DTypeLike

from netlib.blob import Blob, Blobs, BlobVec
from netlib.errors import LayerError
from netlib.fillers import Filler, fill
from netlib.proto import schema
from netlib.proto.messages import LayerParameter, PythonParameter
from netlib.proto.options import NoParameter, block_name
from netlib.proto.prototxt import Message, Place
from netlib.proto.schema import Phase

log = logging.getLogger("netlib")
TRAIN, TEST = 0, 1  # pycaffe's caffe.TRAIN and caffe.TEST
PHASES = {"TRAIN": TRAIN, "TEST": TEST}


class Layer:
    """Base class of all layers.

    name, type, phase   as in the prototxt; phase is netlib.TRAIN or netlib.TEST
    source              the prototxt file that contains this layer
    param               the options; a class declares their type, ``param: ReLUParameter``
    param_str           the string of a Python layer's ``python_param``
    blobs               the parameters, in the order in which new_param created them
    rng                 the random generator of this layer

    The attributes from ``batchwise`` to ``reads_kept`` state what is known of the computation. The
    defaults hold for every layer; setup or reshape sets what depends on options or shapes. Engines
    rely on them for the layer types of this project, whose statements the tests prove, and not for
    a user's class: a subclass inherits them and may compute something else.
    """

    param: Any
    param_type: ClassVar[type] = (
        NoParameter  # dataclass of the options, the declared type of ``param``
    )
    # name of their block; by default the type in snake case, ``inner_product_param``
    param_name: ClassVar[str] = ""
    # blocks that several types read, ``loss_param``
    other_blocks: ClassVar[Mapping[str, type]] = {}
    # blocks of other types that are an error here, and why
    rejected_blocks: ClassVar[Mapping[str, str]] = {}
    # minimum and maximum number of bottoms; None: no maximum
    bottoms: ClassVar[tuple[int, int | None]] = (0, None)
    tops: ClassVar[tuple[int, int | None]] = (0, None)
    in_place: ClassVar[bool] = True  # whether a top may be the same blob as its bottom
    # item n of a top depends only on item n of the bottoms, so a copy of the layer may run on a
    # slice of the batch; it has its own parameters, in ``blobs`` and by name
    batchwise: bool = False
    # batchwise, each top value depends only on one bottom value, and f(0) is finite
    elementwise: bool = False
    reads_bottom: bool = True  # backward reads the data of the bottoms
    # backward reads the data of the tops, so no layer in place may overwrite them; None: unknown
    reads_top: bool | None = None
    reads_kept: bool = True  # backward reads what forward kept in the layer
    reads_signs: bool = False  # backward reads which values of the tops are positive
    # where a gradient flows, a value is positive after the layer iff it was before
    keeps_signs: ClassVar[bool] = False
    default_loss_weight: ClassVar[float] = 0.0  # that of the first top
    is_input: ClassVar[bool] = False  # the caller writes the tops
    # False: backward is an error, and force_backward does not ask for it
    has_gradient: ClassVar[bool] = True
    moving: ClassVar[bool] = False  # forward updates the parameters, which are moving averages

    def __init_subclass__(cls, **options: Any) -> None:
        """Read the type of the options from the declaration of ``param``."""
        super().__init_subclass__(**options)
        declared = inspect.get_annotations(cls).get("param")
        if isinstance(declared, str):
            declared = vars(sys.modules[cls.__module__])[declared]
        if declared is not None:
            cls.param_type = declared

    def __init__(
        self,
        spec: LayerParameter,
        phase: Phase | None = None,
        rng: np.random.Generator | None = None,
        dtype: DTypeLike = np.float32,
    ) -> None:
        """A Python layer's own ``__init__`` passes on the first argument alone, when all is
        set (create.py).
        """
        if phase is None or rng is None:
            return
        self.spec = spec
        self.source = schema.position_of(spec).source
        self.name, self.type, self.phase = spec.name, spec.type, PHASES[phase]
        self.rng = rng
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self.blobs: Blobs = BlobVec(dtype=self.dtype)
        options = PythonParameter if spec.type == "Python" else self.param_type
        self.param = self.read_block(block_name(type(self), spec.type), options)
        self.param_str: str = self.param.param_str if spec.type == "Python" else ""
        self.param_str_ = self.param_str  # its name in Caffe until 2015, as in layers of Fast R-CNN

    # --------------------------------------------------------------------------------- the contract

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the options and create the parameters."""

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Set the shapes of the tops from those of the bottoms."""
        raise NotImplementedError(f"{type(self).__name__} has no reshape")

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Write the data of the tops."""
        raise NotImplementedError(f"{type(self).__name__} has no forward")

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Write the diffs of the bottoms and add to the diffs of the parameters."""
        if not self.has_gradient and any(propagate_down):
            raise self.fail(
                "has no gradient; set propagate_down: false, or remove it from the training net"
            )
        check_backward(self, propagate_down)

    def allow_force_backward(self, bottom_index: int) -> bool:
        """Whether force_backward applies to this bottom; False for labels."""
        return self.has_gradient

    def state(self) -> dict[str, Any]:
        """State that an exact resume needs in addition to the parameters, as plain
        numbers and strings.
        """
        if not isinstance(self.rng, np.random.Generator):  # a generator of the user's own
            return {}
        return {"rng": self.rng.bit_generator.state}

    def restore(self, state: dict[str, Any]) -> None:
        """Restore a state that ``state`` returned."""
        if "rng" in state:
            self.rng.bit_generator.state = state["rng"]

    # ---------------------------------------------------------------------------- for layer authors

    def new_param(self, name: str, shape: Sequence[int], filler: Filler) -> Blob:
        """Create the next parameter and fill it: ``self.gain =
        self.new_param("gain", shape, filler)``.
        """
        blob = self.blobs.add_blob(*shape)
        fill(blob.data, filler, self.rng)
        return blob

    def read_block(self, name: str, kind: type) -> Any:
        """Read an options block into its dataclass; if absent, all defaults.

        Raises PrototxtError.
        """
        # a missing required option is reported at the layer
        nothing = Message([], schema.position_of(self.spec))
        return schema.read(self.spec.blocks.get(name, nothing), kind, name)

    def fail(self, message: str, field: str | None = None, at: Place | None = None) -> LayerError:
        """Return a LayerError with the name of this layer and its place in the prototxt, or
        that of an option.
        """
        block = self.spec.blocks.get(block_name(type(self), self.spec.type))
        where = schema.position_of(self.spec)
        if field is not None and block is not None:
            where = next((f.position for f in block.fields if f.name == field), where)
        return LayerError(f"{at or where}: error: layer {self.name!r}: {message}")

    def canonical_axis(self, axis: int, blob: Blob, what: str = "axis") -> int:
        """Return ``axis`` as a non-negative index; negative axes count from the end.

        Raises LayerError.
        """
        n = len(blob.shape)
        if not -n <= axis < n:
            raise self.fail(
                f"{what} {axis} is out of range for a blob of {n} axes {blob.shape}", what
            )
        return axis % n


class ZeroGradient(Layer):
    """Base class of layers whose gradient is 0, or 0 but for what a subclass adds."""

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Set the diffs of the bottoms to 0."""
        for x, down in zip(bottom, propagate_down):
            if down:
                x.diff[...] = 0


def check_backward(layer: Layer, propagate_down: Sequence[bool]) -> None:
    """Raise LayerError if the layer has to compute a gradient and its class defines
    no ``backward``.
    """
    is_defined = getattr(layer.backward, "__func__", None) is not Layer.backward
    if is_defined or not layer.has_gradient or not (any(propagate_down) or layer.blobs):
        return
    cls = type(layer)
    near = difflib.get_close_matches(
        "backward", [name for name in dir(cls) if not hasattr(Layer, name)], n=1
    )
    advice = (
        f"rename its method {near[0]!r}"
        if near
        else "define it, or set propagate_down: false for each bottom"
    )
    raise layer.fail(
        f"class {cls.__module__}.{cls.__qualname__} defines no backward, so nothing before this layer "
        f"would be trained, and none of its own parameters; {advice}"
    )


def warn(layer: Layer, message: str, at: Place | None = None) -> None:
    """Log a warning with the name of the layer and its place in the prototxt, or
    the place ``at``.
    """
    log.warning("%s: layer %r: %s", at or schema.position_of(layer.spec), layer.name, message)


def warn_of_ignored(layer: Layer, *names: str, block: str = "", advice: str = "") -> None:
    """Warn of options in the layer's own or another block that its type does not
    read, as in Caffe.
    """
    block = block or block_name(type(layer), layer.spec.type)
    tree = layer.spec.blocks.get(block)
    for item in tree.named(*names) if tree else []:
        warn(
            layer,
            f"{layer.type} ignores {item.name} in {block}, as Caffe does{advice}",
            item.position,
        )
