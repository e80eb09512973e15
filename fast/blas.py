"""Configuration of OpenBLAS: the number of threads and the kernels.

NumPy's OpenBLAS reads the environment when it is loaded:

- Threads: the net splits a batch into slices and runs each slice on one thread (slices.py), so a product inside a
  slice should use one thread. Additional BLAS threads compete with them and make a net at least ten times slower. The
  number can also be set after NumPy was imported. Products outside of slices use several (``several_threads``), which
  then wait for the next product without sleeping; the environment limits this time.
- Kernels: OpenBLAS identifies processors by model number and selects its AVX2 kernels for an unknown, newer model,
  even if AVX-512 is available. Naming a known model can double the speed of a product. The kernels cannot be changed
  after NumPy was imported, so netlib must be imported first.

Variables that the user has set are not changed.
"""

from __future__ import annotations

import ctypes
import functools
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_AVX512 = {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}  # used by OpenBLAS's SkylakeX kernels
_FUNCTIONS = ("scipy_openblas_{}_num_threads64_", "scipy_openblas_{}_num_threads", "openblas_{}_num_threads64_",
              "openblas_{}_num_threads")  # fmt: skip
_WAIT = "21"  # logarithm of the clock ticks for which OpenBLAS's threads wait, about 1 ms; their default is 26
_is_ours = False  # whether the number of threads and their waiting were set here


def configure() -> str:
    """Prepare the environment for OpenBLAS, or set its threads if it is loaded; returns a line for the log."""
    global _is_ours
    late = "numpy" in sys.modules
    given = next((f"{os.environ[n]} ({n})" for n in _THREAD_VARIABLES if n in os.environ), None)
    inherited = os.environ.get("OPENBLAS_THREAD_TIMEOUT") == _WAIT  # from a process that called this function
    _is_ours = inherited or (given is None and not late)
    if given is None:
        os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", _WAIT)
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        if late:
            _set_threads(1)
    if "OPENBLAS_CORETYPE" in os.environ:
        kernels = f"kernels {os.environ['OPENBLAS_CORETYPE']} (OPENBLAS_CORETYPE)"
    elif not _is_amd_with_avx512():
        kernels = "kernels chosen by OpenBLAS"
    elif late:
        kernels = "kernels chosen by OpenBLAS (import netlib before numpy for AVX-512 kernels)"
    else:
        os.environ["OPENBLAS_CORETYPE"] = "SkylakeX"
        kernels = "AVX-512 kernels (OPENBLAS_CORETYPE=SkylakeX)"
    return f"BLAS: {kernels}, threads per product: {given or 1}"


def _is_amd_with_avx512() -> bool:
    """Whether this is an AMD processor with AVX-512. On Intel processors OpenBLAS detects AVX-512 itself."""
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False
    flags = next((set(line.split()) for line in info.splitlines() if line.startswith("flags")), set())
    return "AuthenticAMD" in info and flags >= _AVX512


def has_several_threads() -> bool:
    """Whether ``several_threads`` has an effect.

    It has none if the user has set a number of threads, if NumPy was loaded before their waiting was limited, or with
    another BLAS.
    """
    return _is_ours and _functions_of_numpy() is not None


@contextmanager
def several_threads(count: int) -> Iterator[None]:
    """Let OpenBLAS compute each product inside the block with ``count`` threads of BLAS.

    A waiting thread starts in a few microseconds, so products of 0.05 ms gain from it. Where sums are long, rounding
    depends on the number of threads.
    """
    functions = _functions_of_numpy() if _is_ours else None
    before = functions[0]() if functions else 0
    if functions is None or before != 1:  # inside another such block, or the user has called OpenBLAS
        yield
        return
    functions[1](count)
    try:
        yield
    finally:
        functions[1](before)


@functools.cache
def _functions_of_numpy() -> tuple[Callable[[], int], Callable[[int], object]] | None:
    """The functions that return and set the number of threads of NumPy's OpenBLAS; None for another BLAS."""
    from numpy.linalg import _umath_linalg

    try:
        library = ctypes.CDLL(_umath_linalg.__file__)  # finds symbols of the libraries that it needs, too
    except OSError:
        return None
    return _functions_of(library)


def _functions_of(library: ctypes.CDLL) -> tuple[Callable[[], int], Callable[[int], object]] | None:
    for name in _FUNCTIONS:
        if hasattr(library, name.format("set")):
            return getattr(library, name.format("get")), getattr(library, name.format("set"))
    return None


def _set_threads(count: int) -> None:
    """Set the number of threads of every loaded OpenBLAS."""
    for library in _loaded("openblas"):
        if functions := _functions_of(library):
            functions[1](count)


def _loaded(name: str) -> Iterator[ctypes.CDLL]:
    """Yield the shared libraries of this process whose file name contains ``name``."""
    try:
        maps = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return
    for path in sorted({line.split(maxsplit=5)[-1] for line in maps.splitlines() if name in line.rsplit("/", 1)[-1]}):
        try:
            yield ctypes.CDLL(path)
        except OSError:
            continue
