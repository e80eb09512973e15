"""Create a layer from its ``layer { ... }``: find the class and check the option blocks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import DTypeLike

from netlib.building import python_layer
from netlib.errors import PrototxtError
from netlib.layer import Layer, warn
from netlib.proto import schema
from netlib.proto.fork_types import type_advice
from netlib.proto.messages import LayerParameter
from netlib.proto.options import block_name, class_of, layer_types, option_blocks
from netlib.proto.schema import Phase


def check_options(spec: LayerParameter) -> None:
    """Validate all option blocks of a layer against the types that define them.

    Raises PrototxtError.
    """
    _check_blocks(spec)
    blocks = option_blocks()
    for name, tree in spec.blocks.items():
        if name in blocks:
            schema.read(tree, blocks[name], name)


def create(
    spec: LayerParameter,
    phase: Phase,
    rng: np.random.Generator,
    dtype: DTypeLike,
    implementation: Callable[[type[Layer]], type[Layer]] = lambda cls: cls,
) -> Layer:
    """Create the layer that ``spec`` describes. Raises PrototxtError or LayerError.

    ``implementation`` maps the class to an equivalent one of the engine (netlib/engine.py).
    """
    types = layer_types()
    where = schema.position_of(spec, "type")
    if not spec.type:
        raise PrototxtError(where, f"layer {spec.name!r} has no type")
    if spec.type == "Python":
        cls = python_layer.find_class(spec)
    elif spec.type in types:
        cls = implementation(class_of(spec.type, len(spec.bottom)))
    else:
        advice = type_advice(spec.type, types)
        raise PrototxtError(
            where,
            f"unknown layer type {spec.type!r}{advice}; docs/layers.md lists all; a layer of "
            "your own has the type Python",
        )
    own = block_name(cls, spec.type)
    _check_blocks(spec, own)
    layer = _new(cls, spec, phase, rng, dtype)
    for name in cls.rejected_blocks.keys() & spec.blocks:
        raise layer.fail(cls.rejected_blocks[name], at=spec.blocks[name].position)
    for name in sorted(set(spec.blocks) - {own, *cls.other_blocks}):
        # a mistake would show when weights are saved
        schema.read(spec.blocks[name], option_blocks()[name], name)
        warn(
            layer,
            f"{spec.type} does not read {name}; it is ignored, as in Caffe",
            spec.blocks[name].position,
        )
    return layer


def _new(
    cls: type[Layer], spec: LayerParameter, phase: Phase, rng: np.random.Generator, dtype: DTypeLike
) -> Layer:
    """The layer; a Python layer's own ``__init__`` is called with one argument.

    Raises LayerError if that fails.
    """
    if spec.type != "Python":
        return cls(spec, phase, rng, dtype)
    layer = cls.__new__(cls)
    Layer.__init__(layer, spec, phase, rng, dtype)
    if cls.__init__ is not Layer.__init__:
        initialise: Callable[[Layer, LayerParameter], None] = cls.__init__
        try:
            initialise(layer, spec)
        except Exception as error:
            raise layer.fail(f"__init__ failed: {type(error).__name__}: {error}") from error
    return layer


def _check_blocks(spec: LayerParameter, own: str = "") -> None:
    """Reject option blocks that no layer type defines.

    As in Caffe, those of other types than ``own`` are ignored.
    """
    known = {own, *option_blocks()}
    tree = schema.tree_of(spec)
    for item in tree.named(*spec.blocks) if tree else []:
        if item.name not in known:
            raise schema.unknown_field(item, sorted(known), "LayerParameter")
