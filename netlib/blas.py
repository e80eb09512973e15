"""Choose BLAS kernels and threads, before NumPy is first imported.

NumPy's OpenBLAS decides once, when it is loaded, from the environment:

- Threads: the net cuts a batch into slices and gives every slice a thread of its own (see slices.py);
  a product inside a slice should then use one thread. BLAS threads on top of that only get in the way.
- Kernels: OpenBLAS knows processors by model number and takes its AVX2 kernels for a model that is too
  new for it, even where AVX-512 is there. Naming a model it knows doubles the speed of a product.

Nothing that the user has set is touched, and nothing happens if NumPy was imported first.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_AVX512 = {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}  # what OpenBLAS's SkylakeX kernels use


def configure() -> str:
    """Set the environment for OpenBLAS; returns one line for the log."""
    if "numpy" in sys.modules and "OPENBLAS_NUM_THREADS" not in os.environ:
        return "BLAS: NumPy was imported before netlib, its threads and kernels are left as they are"
    notes = []
    if not any(name in os.environ for name in _THREAD_VARIABLES):
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
    if "OPENBLAS_CORETYPE" in os.environ:
        notes.append(f"kernels {os.environ['OPENBLAS_CORETYPE']} (OPENBLAS_CORETYPE)")
    elif _is_amd_with_avx512():
        os.environ["OPENBLAS_CORETYPE"] = "SkylakeX"
        notes.append("AVX-512 kernels (OPENBLAS_CORETYPE=SkylakeX)")
    else:
        notes.append("kernels chosen by OpenBLAS")
    threads = next((os.environ[n] for n in _THREAD_VARIABLES if n in os.environ), "1")
    return f"BLAS: {', '.join(notes)}, {threads} thread{'' if threads == '1' else 's'} per product"


def _is_amd_with_avx512() -> bool:
    """Only AMD's: on Intel processors OpenBLAS finds AVX-512 by itself."""
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False
    flags = next((set(line.split()) for line in info.splitlines() if line.startswith("flags")), set())
    return "AuthenticAMD" in info and flags >= _AVX512
