"""The layer types and their options blocks: the one place in netlib that looks up the package ``layers``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from netlib.errors import NetlibError
from netlib.files.paths import own_package
from netlib.proto.messages import LossParameter, PythonParameter


@dataclass(frozen=True)
class NoParameter:
    """A layer type without options."""


def layer_types() -> dict[str, Any]:
    """Every known layer type by name, with its class."""
    package = own_package("layers")
    types: dict[str, Any] | None = getattr(package, "LAYER_TYPES", None)
    if types is None:
        raise NetlibError(
            f"{package.__file__}: was imported as 'layers', which is this project's package; import netlib before it, "
            "or rename it"
        )
    return types


def class_of(type_name: str, bottoms: int) -> Any:
    """The class of a layer type with so many bottoms. The type must be known."""
    cls = layer_types()[type_name]
    return own_package("layers").BY_BOTTOMS.get((type_name, bottoms), cls)


def option_blocks() -> dict[str, type]:
    """Every options block by name, with its dataclass."""
    blocks: dict[str, type] = {"python_param": PythonParameter, "loss_param": LossParameter}
    for name, cls in layer_types().items():
        blocks.update(cls.other_blocks)
        if cls.param_type is not NoParameter:
            blocks[block_name(cls, name)] = cls.param_type
    return blocks


def block_name(cls: Any, type_name: str) -> str:
    """Name of the options block of a layer type, whose class is ``cls``."""
    if type_name == "Python":  # also if the user's class derives from one of ours
        return "python_param"
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", type_name)
    name: str = cls.param_name or words.lower() + "_param"
    return name
