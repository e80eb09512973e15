"""A table of layer classes whose files are imported when a net needs them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping
from typing import Any, TypeVar

from netlib.files.own_modules import own_module

K = TypeVar("K")


class LayerTable(MutableMapping[K, Any]):
    """Keys, such as layer types, and classes.

    places  the place of each class in the package ``layers``: ``vision.pooling.Pooling``
    """

    def __init__(self, places: Mapping[K, str]) -> None:
        self._places: dict[K, str | None] = dict(places)
        self._classes: dict[K, Any] = {}

    def __getitem__(self, key: K) -> Any:
        """The class; its file is imported if necessary."""
        if key not in self._classes:
            place = self._places[key]
            assert place is not None
            module, _, name = place.rpartition(".")
            self._classes[key] = getattr(own_module(f"layers.{module}"), name)
        return self._classes[key]

    def __setitem__(self, key: K, cls: Any) -> None:
        self._places.setdefault(key, None)
        self._classes[key] = cls

    def __delitem__(self, key: K) -> None:
        del self._places[key]
        self._classes.pop(key, None)

    def __contains__(self, key: object) -> bool:
        return key in self._places

    def __iter__(self) -> Iterator[K]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)
