"""Layer types, tables of their classes, and their options blocks; the only module of netlib that
looks up the package ``layers``.
"""

from __future__ import annotations

import re
from collections import UserDict
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any, TypeVar

from netlib.files.own_modules import own_module
from netlib.proto.messages import BLOCKS, LossParameter, PythonParameter

K = TypeVar("K")
PACKAGE = "layers"


def class_at(package: str, place: str) -> Any:
    """The class at a place in a package of this project: ``layers`` and
    ``vision.pooling.Pooling``.
    """
    module, _, name = place.rpartition(".")
    return getattr(own_module(f"{package}.{module}"), name)


def place_of(cls: type) -> str:
    """The place of a class in the package ``layers``; of a class elsewhere one that no
    class of ours has.
    """
    return f"{cls.__module__}.{cls.__qualname__}".removeprefix(f"{PACKAGE}.")


class LayerTable(UserDict[K, Any]):
    """Keys, such as layer types, and classes: made from the place of each class in the package
    ``layers``, for example ``vision.pooling.Pooling``.
    """

    def __getitem__(self, key: K) -> Any:
        """The class; its file is imported if necessary."""
        entry = self.data[key]
        if isinstance(entry, str):
            entry = self.data[key] = class_at(PACKAGE, entry)
        return entry


@dataclass(frozen=True)
class NoParameter:
    """A layer type without options."""


def layer_types() -> MutableMapping[str, Any]:
    """Return every known layer type: name -> class, whose file is imported when it is looked up."""
    types: MutableMapping[str, Any] = own_module("layers").LAYER_TYPES
    return types


def layer_type_list() -> list[str]:
    """The names of all layer types."""
    return sorted([*layer_types(), "Python"])


def class_of(type_name: str, bottoms: int) -> Any:
    """The class of a known layer type for this number of bottoms."""
    special = own_module("layers").BY_BOTTOMS
    return special.get((type_name, bottoms)) or layer_types()[type_name]


class _OptionBlocks(UserDict[str, Any]):
    """Options blocks: name -> dataclass, or None if a layer has it, which is imported when the
    block is looked up.
    """

    def __getitem__(self, block: str) -> Any:
        """The dataclass of a block."""
        return self.data[block] or _of_layer(block)


def _of_layer(block: str) -> Any:
    """The dataclass of a block of a layer type that reads it."""
    owners: Mapping[str, str] = own_module("layers").BLOCK_OWNERS
    named = (name for name in layer_types() if _block_of(name) == block)
    owner = owners.get(block) or next(named)
    cls = layer_types()[owner]
    return cls.other_blocks.get(block, cls.param_type)


_BLOCKS = _OptionBlocks(
    {**dict.fromkeys(BLOCKS), "python_param": PythonParameter, "loss_param": LossParameter}
)


def option_blocks() -> Mapping[str, type]:
    """Return every options block: name -> dataclass."""
    return _BLOCKS


def block_name(cls: Any, type_name: str) -> str:
    """Name of the options block of a layer type with class ``cls``."""
    if type_name == "Python":  # even if the class derives from a layer of this project
        return "python_param"
    name: str = cls.param_name or _block_of(type_name)
    return name


def _block_of(type_name: str) -> str:
    """Name of an options block that is called after a layer type, as ``inner_product_param``."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", type_name)
    return words.lower() + "_param"
