"""The check of layers whose bottoms are images."""

from __future__ import annotations

from collections.abc import Iterable

from netlib.blob import Blob
from netlib.layer import Layer


def check_images(layer: Layer, bottom: Iterable[Blob]) -> None:
    """Raise LayerError unless these bottoms, the first ones of the layer, have four axes."""
    for name, blob in zip(layer.spec.bottom, bottom):
        if len(blob.shape) != 4:
            raise layer.fail(f"bottom {name!r} has shape {blob.shape}, expected (N, C, H, W)")
