"""Selection of the engine that computes a net.

    plain   runs each layer of layers/ once on the whole batch, in the order of the file (plain.py)
    fast    computes the same results, up to rounding, faster, with the folder fast/; only this module refers to it

``netlib.Net(..., engine="plain")`` selects it for one net, NETLIB_ENGINE for a process; the default is ``fast`` if the
folder fast/ exists. This module must not import NumPy at the top, because fast/ sets up BLAS before.
"""

from __future__ import annotations

import functools
import importlib
import os
import sys
from collections.abc import Callable, Iterable
from types import ModuleType
from typing import TYPE_CHECKING, TypeVar

from netlib.files.paths import ROOT, own_package

if TYPE_CHECKING:
    from netlib.engine.plain import Engine

T = TypeVar("T")
NAMES = ("fast", "plain")


def available_cpus() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def prepare() -> str:
    """Let fast/ configure BLAS; this affects the rounding of both engines. Returns a line for the log."""
    if not has_fast():
        return "BLAS: as NumPy sets it up"
    note: str = _fast("blas").configure()
    return note


def has_fast() -> bool:
    """Whether the fast engine is available and no other module named ``fast`` is imported."""
    is_ours = "fast" not in sys.modules or str(ROOT / "fast") in getattr(sys.modules["fast"], "__path__", [])
    return is_ours and (ROOT / "fast" / "engine.py").is_file()


def get(name: str | None = None, default: str | None = None) -> Engine:
    """Return an engine by name; by default that of NETLIB_ENGINE, else ``default``, else "fast" if available.

    Raises NetlibError.
    """
    return _engine(name or os.environ.get("NETLIB_ENGINE") or default or ("fast" if has_fast() else "plain"))


def for_each(items: Iterable[T], job: Callable[[T], None]) -> None:
    """Call ``job`` with every item, in any order, on the threads of the default engine; the plain engine has one."""
    get().run([functools.partial(job, item) for item in items])


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
        raise NetlibError("the engine 'fast' needs the folder fast/, which is missing; use the engine 'plain'")
    layer_types()  # reports another package named layers before fast/ fails to import from it
    fast: Engine = _fast("engine").FastEngine()
    return fast


def _fast(module: str) -> ModuleType:
    own_package("fast")
    return importlib.import_module(f"fast.{module}")
