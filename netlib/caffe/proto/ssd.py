"""The names of the classes of a detector, as files of SSD's fork of Caffe list them.

Nets do not read them. The other messages of SSD are in forks.proto.
"""

from __future__ import annotations

from dataclasses import dataclass

from netlib.proto.schema import numbered


@dataclass(frozen=True)
class LabelMapItem:
    """A class in a LabelMap."""

    name: str = numbered(1, "")
    label: int = numbered(2, 0)
    display_name: str = numbered(3, "")


@dataclass(frozen=True)
class LabelMap:
    """The classes of a detector."""

    item: tuple[LabelMapItem, ...] = numbered(1, ())
