"""Configuration of OpenBLAS, the number of threads and the kernels, and of the C library's memory.

NumPy's OpenBLAS reads the environment when it is loaded:

- Threads: the net splits a batch into slices and runs each slice on one thread (slices.py), so a
  product inside a slice should use one thread. Additional BLAS threads compete with them and make a
  net at least ten times slower. The number can also be set after NumPy was imported.
- Kernels: OpenBLAS identifies processors by model number and selects its AVX2 kernels for an
  unknown, newer model, even if AVX-512 is available. Naming a known model can double the speed of a
  product. The kernels cannot be changed after NumPy was imported, so netlib must be imported first.

Variables that the user has set are not changed.

The GNU C library returns the memory of an array to the system when it is freed, and the next one of
this size costs a page fault for each 4 kB again, up to a third of the time of layers with temporary
arrays; ``mallopt`` makes it keep it.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from pathlib import Path

_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
# used by OpenBLAS's SkylakeX kernels
_AVX512 = {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
# M_TRIM_THRESHOLD and M_MMAP_THRESHOLD, of which 32 MB is the maximum
_KEEPING = {-1: 256 << 20, -3: 32 << 20}
_SETTERS = (
    "scipy_openblas_set_num_threads64_",
    "scipy_openblas_set_num_threads",
    "openblas_set_num_threads64_",
    "openblas_set_num_threads",
)


def configure() -> str:
    """Prepare the environment for OpenBLAS, or set its threads if it is loaded; returns a
    line for the log.
    """
    _keep_freed_memory()
    late = "numpy" in sys.modules
    given = next((f"{os.environ[n]} ({n})" for n in _THREAD_VARIABLES if n in os.environ), None)
    if given is None:
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


def _keep_freed_memory() -> None:
    """Let the GNU C library use freed memory again, unless the user has set its thresholds."""
    if (
        sys.platform != "linux"
        or {"MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_"} & os.environ.keys()
    ):
        return
    # other C libraries have none
    if (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        for option, size in _KEEPING.items():
            mallopt(ctypes.c_int(option), ctypes.c_int(size))


def _is_amd_with_avx512() -> bool:
    """Whether this is an AMD processor with AVX-512.

    On Intel processors OpenBLAS detects AVX-512 itself.
    """
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False
    flags = next(
        (set(line.split()) for line in info.splitlines() if line.startswith("flags")), set()
    )
    return "AuthenticAMD" in info and flags >= _AVX512


def _set_threads(count: int) -> None:
    """Set the number of threads of every loaded OpenBLAS."""
    for library in _loaded("openblas"):
        for name in _SETTERS:
            if setter := getattr(library, name, None):
                setter(ctypes.c_int(count))
                break


def _loaded(name: str) -> Iterator[ctypes.CDLL]:
    """Yield the shared libraries of this process whose file name contains ``name``."""
    try:
        maps = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return
    found = [line for line in maps.splitlines() if name in line.rsplit("/", 1)[-1]]
    for path in sorted({line.split(maxsplit=5)[-1] for line in found}):
        try:
            yield ctypes.CDLL(path)
        except OSError:
            continue
