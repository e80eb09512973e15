"""Nets and weights in temporary folders; all tests are skipped without the packages onnx
and onnxruntime.
"""

from pathlib import Path

import numpy as np
import pytest

import netlib
from tests.support.onnx_nets import net_text


@pytest.fixture(autouse=True, scope="session")
def onnx():
    pytest.importorskip("onnxruntime")
    return pytest.importorskip("onnx")


@pytest.fixture
def files(here):
    """``files(layers, shapes ...)``: net.prototxt and net.caffemodel.h5 with random parameters,
    in a new folder.
    """

    def make(layers: str, *shapes: tuple[int, ...]) -> tuple[str, str]:
        Path("net.prototxt").write_text(net_text(layers, *shapes))
        net, rng = netlib.Net("net.prototxt", netlib.TEST, seed=1), np.random.default_rng(1)
        for blobs in net.params.values():
            for blob in blobs:
                blob.data[...] = rng.uniform(0.2, 1, blob.shape) * rng.choice([-1, 1], blob.shape)
        for layer in net.layers:
            if layer.type == "BatchNorm":
                layer.blobs[1].data[...] = abs(layer.blobs[1].data)
                layer.blobs[2].data[...] = 3
            if layer.type == "BN" and len(layer.blobs) == 4:
                layer.blobs[3].data[...] = abs(layer.blobs[3].data)
        net.save("net.caffemodel.h5")
        return "net.prototxt", "net.caffemodel.h5"

    return make
