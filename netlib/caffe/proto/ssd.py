"""The messages of SSD's fork of Caffe for labels and annotations, which its scripts read and write.

Nets do not read them. The options of SSD's training layers, which are not supported,
are in forks.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from netlib.proto.messages import Datum
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


@dataclass(frozen=True)
class NormalizedBBox:
    """A box in parts of the width and the height of its image."""

    xmin: float = numbered(1, 0.0)
    ymin: float = numbered(2, 0.0)
    xmax: float = numbered(3, 0.0)
    ymax: float = numbered(4, 0.0)
    label: int = numbered(5, 0)
    difficult: bool = numbered(6, False)
    score: float = numbered(7, 0.0)
    size: float = numbered(8, 0.0)


@dataclass(frozen=True)
class Annotation:
    """An object in an image."""

    instance_id: int = numbered(1, 0)
    bbox: NormalizedBBox | None = numbered(2, None)


@dataclass(frozen=True)
class AnnotationGroup:
    """The objects of one class in an image."""

    group_label: int = numbered(1, 0)
    annotation: tuple[Annotation, ...] = numbered(2, ())


@dataclass(frozen=True)
class AnnotatedDatum:
    """An image with its objects, as stored in SSD's databases."""

    datum: Datum | None = numbered(1, None)
    type: Literal["BBOX"] | None = numbered(2, None)
    annotation_group: tuple[AnnotationGroup, ...] = numbered(3, ())
