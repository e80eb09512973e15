"""Layer types and their options blocks; the only module of netlib that looks up the package ``layers``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from netlib.files.own_modules import own_module
from netlib.proto.messages import LossParameter, PythonParameter


@dataclass(frozen=True)
class NoParameter:
    """A layer type without options."""


def layer_types() -> dict[str, Any]:
    """Return every known layer type: name -> class."""
    types: dict[str, Any] = own_module("layers").LAYER_TYPES
    return types


def class_of(type_name: str, bottoms: int) -> Any:
    """The class of a known layer type for this number of bottoms."""
    cls = layer_types()[type_name]
    return own_module("layers").BY_BOTTOMS.get((type_name, bottoms), cls)


def option_blocks() -> dict[str, type]:
    """Return every options block: name -> dataclass."""
    blocks: dict[str, type] = {"python_param": PythonParameter, "loss_param": LossParameter}
    for name, cls in layer_types().items():
        blocks.update(cls.other_blocks)
        if cls.param_type is not NoParameter:
            blocks[block_name(cls, name)] = cls.param_type
    return blocks


def block_name(cls: Any, type_name: str) -> str:
    """Name of the options block of a layer type with class ``cls``."""
    if type_name == "Python":  # even if the class derives from a layer of this project
        return "python_param"
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", type_name)
    name: str = cls.param_name or words.lower() + "_param"
    return name
