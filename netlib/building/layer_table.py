"""Tables of layer classes whose files are imported when a net needs them."""

from __future__ import annotations

from collections import UserDict
from typing import Any, TypeVar

from netlib.files.own_modules import own_module

K = TypeVar("K")
PACKAGE = "layers"


def class_at(package: str, place: str) -> Any:
    """The class at a place in a package of this project: ``layers`` and ``vision.pooling.Pooling``."""
    module, _, name = place.rpartition(".")
    return getattr(own_module(f"{package}.{module}"), name)


def place_of(cls: type) -> str:
    """The place of a class in the package ``layers``; of a class elsewhere one that no class of ours has."""
    return f"{cls.__module__}.{cls.__qualname__}".removeprefix(f"{PACKAGE}.")


class LayerTable(UserDict[K, Any]):
    """Keys, such as layer types, and classes: made from the place of each class in the package ``layers``, for example
    ``vision.pooling.Pooling``.
    """

    def __getitem__(self, key: K) -> Any:
        """The class; its file is imported if necessary."""
        entry = self.data[key]
        if isinstance(entry, str):
            entry = self.data[key] = class_at(PACKAGE, entry)
        return entry
