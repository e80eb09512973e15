"""BLAS threads and kernels are configured, before or after NumPy is imported, and the user's
settings are kept.
"""

import ctypes
import os
import sys
from pathlib import Path

import pytest

from tests.support.running import run_python

OURS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_CORETYPE")


def run(code: str, **environment: str) -> str:
    """Run code in a new Python process and return its output."""
    return run_python("-c", code, **(dict.fromkeys(OURS) | environment)).out.strip()


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
def test_blas_uses_one_thread_per_product(first: str) -> None:
    counts = run(first + THREADS).split()
    if not counts:
        pytest.skip("NumPy has no OpenBLAS here")
    assert set(counts) == {"1"}


def test_environment_variables_of_the_user_take_precedence() -> None:
    note = run(
        "import netlib; print(netlib.BLAS_NOTE)",
        OPENBLAS_NUM_THREADS="2",
        OPENBLAS_CORETYPE="Haswell",
    )
    kernels = "kernels Haswell (OPENBLAS_CORETYPE)"
    assert note == f"BLAS: {kernels}, threads per product: 2 (OPENBLAS_NUM_THREADS)"


def test_an_import_after_numpy_is_reported() -> None:
    note = run(
        "import numpy, netlib, os; print(netlib.BLAS_NOTE, os.environ.get('OPENBLAS_CORETYPE'))"
    )
    assert "kernels chosen by OpenBLAS" in note and note.endswith("None")


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="the thresholds are those of the GNU C library"
)
@pytest.mark.parametrize(
    ("settings", "is_reused"), [({}, True), ({"MALLOC_TRIM_THRESHOLD_": "100000"}, False)]
)
def test_freed_memory_is_used_again(settings: dict[str, str], is_reused: bool) -> None:
    """Arrays of a few MB cost no page faults once others have been freed, unless the user has set
    another threshold.
    """
    if not hasattr(ctypes.CDLL(None), "mallopt"):
        pytest.skip("not the GNU C library")
    code = (
        "import netlib, numpy, resource\n"
        "def faults(): return resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
        "def work(): return [numpy.ones(500_000), numpy.ones(500_000)]\n"
        "work(); work(); before = faults()\nfor _ in range(20): work()\nprint(faults() - before)"
    )
    faults = int(run(code, **settings))
    assert (faults < 2000) == is_reused


@pytest.mark.skipif(
    not Path("/proc/self/maps").exists(), reason="Linux lists the files that a process has mapped"
)
def test_a_mapped_file_with_an_odd_name(tmp_path: Path) -> None:
    """A mapped file whose name is not UTF-8 is skipped, and the libraries after it are found."""
    (tmp_path / os.fsdecode(b"a_openblas\xe9.so")).write_bytes(b"no library")
    code = (
        "import mmap, os, sys, netlib; from fast import blas\n"
        f"file = open(os.path.join({str(tmp_path)!r}, os.fsdecode(b'a_openblas\\xe9.so')), 'rb')\n"
        "held = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)\n"
        "import numpy; print(len(list(blas._loaded('openblas'))))"
    )
    without_file = (
        "import netlib, numpy; from fast import blas; print(len(list(blas._loaded('openblas'))))"
    )
    assert run(code) == run(without_file)
