"""What ranks that train together tell each other first: what must be the same for their means to mean anything."""

from __future__ import annotations

import functools
import zlib
from collections.abc import Sequence
from typing import Any, Protocol

from netlib import schema
from netlib.messages import SolverParameter
from netlib.net import Net
from netlib.plain import Engine
from netlib.sharing import Param

IDENTITIES = ("files", "list", "database")  # of a data layer's state: what it reads


class Solver(Protocol):
    """What is asked of a solver here."""

    param: SolverParameter
    net: Net
    iter: int
    engine: Engine


def facts_of(solver: Solver) -> dict[str, Any]:
    """Name -> what must be the same on all ranks."""
    states = solver.net.layer_states()
    return {
        "solver prototxt": _crc(repr(solver.param)),
        "net prototxt": _crc(str(schema.to_tree(solver.net.param))),
        "data": {name: [state[key] for key in IDENTITIES if key in state] for name, state in states.items()},
        "engine": solver.engine.name,
        "iteration": solver.iter,
        "set of parameters": f"{crc_of(solver.net.learnable):08x}",
    }


def crc_of(params: Sequence[Param]) -> int:
    """A checksum of parameters, all bits of them."""
    return functools.reduce(lambda crc, param: zlib.crc32(param.blob.data.data, crc), params, 0)


def _crc(text: str) -> str:
    return f"{zlib.crc32(text.encode()):08x}"
