"""Test nets with weights from a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from netlib import fillers
from netlib.blob import Blob
from netlib.files import Content
from netlib.fillers import Filler
from netlib.graph import LayerHook
from netlib.layer import TEST, Layer
from netlib.net import Net


class Unfilled(LayerHook):
    """Sets parameters to zero instead of drawing initial values, which takes long:
    weights replace them.
    """

    def before_setup(self, layer: Layer) -> None:
        """Replace the layer's ``new_param``."""

        def new_param(name: str, shape: Sequence[int], filler: Filler) -> Blob:
            blob = layer.blobs.add_blob(*shape)
            fillers.check(blob.shape, filler)
            return blob

        layer.new_param = new_param  # type: ignore[method-assign]

    def after_setup(self, layer: Layer, seed: np.random.SeedSequence) -> None:
        """Give the layer its own ``new_param`` back."""
        del layer.new_param


def trained(model: str | Path, weights: str | Path | Content, engine: str | None = None) -> Net:
    """A test net with its weights.

    Raises NetlibError, also if a layer has no weights in the file.
    """
    net = Net(model, TEST, engine=engine, layer_hook=Unfilled())
    net.copy_from(weights, strict=True)
    return net
