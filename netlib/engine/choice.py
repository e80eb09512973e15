"""Two engines, one switch: who computes a net.

    plain   each layer once, on the whole batch, in file order: what stands in layers/ is what runs (plain.py)
    fast    the same net and the same results, to rounding, faster: the folder fast/, which is asked for only here

``netlib.Net(..., engine="plain")`` chooses for one net, NETLIB_ENGINE for a whole process; otherwise it is ``fast`` if
the folder fast/ is there. Nothing is imported at first that loads NumPy, because fast/ must set up BLAS before.
"""

from __future__ import annotations

import functools
import importlib
import os
import sys
from types import ModuleType
from typing import TYPE_CHECKING

from netlib.files.paths import ROOT, own_package

if TYPE_CHECKING:
    from netlib.engine.plain import Engine

NAMES = ("fast", "plain")


def available_cpus() -> int:
    """Number of processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def prepare() -> str:
    """Let fast/ set up BLAS, whichever engine is chosen: its bits depend on it. Returns a line for the log."""
    if not has_fast():
        return "BLAS: as NumPy sets it up"
    note: str = _fast("blas").configure()
    return note


def has_fast() -> bool:
    """Is the fast engine there, and nothing else of this name imported in its place?"""
    is_ours = "fast" not in sys.modules or str(ROOT / "fast") in getattr(sys.modules["fast"], "__path__", [])
    return is_ours and (ROOT / "fast" / "engine.py").is_file()


def get(name: str | None = None, default: str | None = None) -> Engine:
    """The engine of this name; without one NETLIB_ENGINE's, then ``default``, then the house's. Raises NetlibError."""
    return _engine(name or os.environ.get("NETLIB_ENGINE") or default or ("fast" if has_fast() else "plain"))


@functools.cache
def _engine(name: str) -> Engine:
    from netlib.engine.plain import Engine
    from netlib.errors import NetlibError, did_you_mean
    from netlib.proto.options import layer_types

    if name == "plain":
        return Engine()
    if name != "fast":
        raise NetlibError(f"unknown engine {name!r}{did_you_mean(name, NAMES)}; known: {', '.join(NAMES)}")
    if not has_fast():
        raise NetlibError("the engine 'fast' is the folder fast/, which is not there; use the engine 'plain'")
    layer_types()  # something else that is called layers is named here, before fast/ stumbles over it
    fast: Engine = _fast("engine").FastEngine()
    return fast


def _fast(module: str) -> ModuleType:
    own_package("fast")
    return importlib.import_module(f"fast.{module}")
