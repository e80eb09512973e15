"""Selection of the engine that computes a net.

    plain   runs each layer of layers/ once on the whole batch, in the order of the file (plain.py)
    fast    computes the same results, up to rounding, faster, with the folder fast/; only this module refers to it

``netlib.Net(..., engine="plain")`` selects it for one net, NETLIB_ENGINE for a process; the default is ``fast`` if the
folder fast/ exists. This module must not import NumPy at the top, because fast/ sets up BLAS before.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, TypeVar

from netlib.files.own_modules import own_module
from netlib.files.paths import ROOT

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
    note: str = own_module("fast.blas").configure()
    return note


@functools.cache
def has_fast() -> bool:
    """Whether the fast engine is available."""
    return (ROOT / "fast" / "engine.py").is_file()


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

    if name == "plain":
        return Engine()
    if name != "fast":
        raise NetlibError(f"unknown engine {name!r}{did_you_mean(name, NAMES)}; known: {', '.join(NAMES)}")
    if not has_fast():
        raise NetlibError("the engine 'fast' needs the folder fast/, which is missing; use the engine 'plain'")
    own_module("layers")  # from which fast/ imports
    fast: Engine = own_module("fast.engine").FastEngine()
    return fast
