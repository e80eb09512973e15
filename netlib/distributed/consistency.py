"""Consistency checks between ranks: values that must be equal on all ranks for their means to be valid."""

from __future__ import annotations

import functools
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from netlib.blob import Array
from netlib.distributed.ranks import Ranks
from netlib.layer import Layer
from netlib.net import Net
from netlib.params import Param
from netlib.proto import schema
from netlib.training.callbacks import Solver

COMPARED_EVERY = 100  # iterations between comparisons of the parameters


def traits_of(solver: Solver) -> dict[str, Any]:
    """Return the values, by name, that must be equal on all ranks before their first step."""
    return {
        "solver prototxt": _crc(repr(solver.param)),
        "net prototxt": _crc(str(schema.to_tree(solver.net.param))),
        **{f"data in layer {layer.name!r}": reads for layer in solver.net.layers if (reads := _reads(layer))},
        "engine": solver.engine.name,
        "iteration": solver.iter,
        "parameters": f"{_crc_of(solver.net.learnable):08x}",
    }


def checksum(solver: Solver) -> int | None:
    """Checksum of all parameters in iterations in which they are compared, else None."""
    if solver.rank_count == 1 or solver.iter % COMPARED_EVERY:
        return None
    return _crc_of(solver.net.learnable)


def mean_outputs(net: Net, ranks: Ranks) -> Mapping[str, Array]:
    """Outputs of the net; at rank 0, their means over the ranks."""
    own = {name: net.blobs[name].data for name in net.outputs}
    others = ranks.gather({name: y.tolist() for name, y in own.items()} if ranks.count > 1 else {})
    means = {}
    for name, y in own.items():
        all_ranks = [y, *(np.asarray(other[name]) for other in others)]
        alike = all(other.shape == y.shape for other in all_ranks)  # false after layers that drop rows, such as Filter
        means[name] = np.mean(all_ranks, axis=0) if others and alike else y
    return means


def _reads(layer: Layer) -> Any:
    """Identity of the data that a layer reads from files; None for other layers."""
    return layer.reads() if hasattr(layer, "reads") else None


def _crc_of(params: Sequence[Param]) -> int:
    """Checksum of the values of parameters."""
    return functools.reduce(lambda crc, param: zlib.crc32(param.blob.data.data, crc), params, 0)


def _crc(text: str) -> str:
    return f"{zlib.crc32(text.encode()):08x}"
