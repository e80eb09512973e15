"""BLAS threads and kernels are chosen, whoever imports NumPy first, and never against the user."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OURS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_CORETYPE")


def run(code: str, **environment: str) -> str:
    """What a fresh Python prints."""
    clean = {k: v for k, v in os.environ.items() if k not in OURS}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env={**clean, **environment}, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


THREADS = """
import ctypes
from fast import blas
for library in blas._loaded("openblas"):
    for name in ("scipy_openblas_get_num_threads64_", "openblas_get_num_threads"):
        if getter := getattr(library, name, None):
            print(getter())
            break
"""


@pytest.mark.parametrize("first", ["import netlib, numpy", "import numpy, netlib"])
def test_one_thread_a_product(first: str) -> None:
    """OpenBLAS itself says that it uses one thread."""
    counts = run(first + THREADS).split()
    if not counts:
        pytest.skip("NumPy has no OpenBLAS here")
    assert set(counts) == {"1"}


def test_the_user_decides() -> None:
    """What is set in the environment stays, and the log says so."""
    note = run("import netlib; print(netlib.BLAS_NOTE)", OPENBLAS_NUM_THREADS="2", OPENBLAS_CORETYPE="Haswell")
    assert note == "BLAS: kernels Haswell (OPENBLAS_CORETYPE), threads per product: 2 (OPENBLAS_NUM_THREADS)"


def test_late_import_is_told() -> None:
    """After NumPy, kernels cannot be changed any more."""
    note = run("import numpy, netlib, os; print(netlib.BLAS_NOTE, os.environ.get('OPENBLAS_CORETYPE'))")
    assert "kernels chosen by OpenBLAS" in note and note.endswith("None")
