"""Tables of layer classes whose files are imported when a net needs them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping
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


class LayerTable(MutableMapping[K, Any]):
    """Keys, such as layer types, and classes.

    places  the place of each class in the package ``layers``: ``vision.pooling.Pooling``
    """

    def __init__(self, places: Mapping[K, str]) -> None:
        self._entries: dict[K, Any] = dict(places)  # places until they are looked up, then classes

    def __getitem__(self, key: K) -> Any:
        """The class; its file is imported if necessary."""
        entry = self._entries[key]
        if isinstance(entry, str):
            entry = self._entries[key] = class_at(PACKAGE, entry)
        return entry

    def __setitem__(self, key: K, cls: Any) -> None:
        self._entries[key] = cls

    def __delitem__(self, key: K) -> None:
        del self._entries[key]

    def __contains__(self, key: object) -> bool:
        return key in self._entries

    def __iter__(self) -> Iterator[K]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)
