"""Data of docs/small_net.html: the net of docs/book/small.prototxt as a list, with the weights of chapter 5."""

from __future__ import annotations

from typing import Any

import numpy as np

import netlib
from netlib.files.paths import ROOT

FILE = ROOT / "docs" / "book" / "small.prototxt"
INPUTS = {"x": [2.0], "t": [1.0]}
PARAMS: dict[str, list[Any]] = {"first": [[[1.5]]], "second": [[[1], [-1]], [0, 1]], "out": [[[0.5, 1]]]}


def net() -> netlib.Net:
    """The net, with the numbers of the chapter."""
    made = netlib.Net(FILE, netlib.TRAIN, dtype=np.float64, engine="plain")
    for name, values in INPUTS.items():
        made.blobs[name].data[...] = values
    for name, params in PARAMS.items():
        for blob, value in zip(made.params[name], params):
            blob.data[...] = value
    return made


def data() -> dict[str, Any]:
    """Layers in order, each with the blobs that it reads and writes, whether it runs backwards, and its parameters."""
    made = net()
    name_of = {id(blob): name for name, blob in made.blobs.items()}
    return {
        "inputs": {name: list(values) for name, values in INPUTS.items()},
        "losses": {name: weight for _, weight, name in made.losses},
        "layers": [
            {
                "name": at.layer.name, "type": at.layer.type,
                "bottom": [name_of[id(blob)] for blob in at.bottom], "top": [name_of[id(blob)] for blob in at.top],
                "backward": at.needs_backward, "down": list(at.propagate_down),
                "params": [np.asarray(blob.data).tolist() for blob in at.layer.blobs],
                "operation": at.layer.param.operation if at.layer.type == "Reduction" else "",
            }
            for at in made.connections
        ],
    }
