"""Hands in frames do not depend on the BLAS kernels, which OpenBLAS selects by processor
(docs/reliability.md).
"""

from __future__ import annotations

import importlib
import json
import os

import numpy as np

from tests.support.running import run_python

SCRIPT = """
import json
import netlib
from handpose.estimate.packaged import load_predictor
from handpose.sequences.recordings import SyntheticRecording
depth = SyntheticRecording("body", seed=9).frame(20).depth
print(json.dumps([load_predictor(fit=fit).in_frame(depth).xyz.tolist() for fit in ("accurate", "fast")]))
"""


def joints(kernels: str) -> np.ndarray:
    """(fits, K, 3) mm of a synthetic frame with these kernels; Nehalem's with NumPy's SIMD
    extensions off as well.

    Other BLAS libraries than OpenBLAS ignore the choice.
    """
    core = importlib.import_module(
        f"numpy.{'_core' if np.__version__ >= '2' else 'core'}._multiarray_umath"
    )
    extensions = " ".join(name for name in core.__cpu_dispatch__ if core.__cpu_features__[name])
    off = extensions if kernels == "Nehalem" else os.environ.get("NPY_DISABLE_CPU_FEATURES")
    done = run_python("-c", SCRIPT, OPENBLAS_CORETYPE=kernels, NPY_DISABLE_CPU_FEATURES=off)
    return np.array(json.loads(done.out))


def test_kernels() -> None:
    """The joints agree to 0.1 mm for two sets of kernels and every fit."""
    apart = np.linalg.norm(joints("Haswell") - joints("Nehalem"), axis=-1)
    assert apart.shape == (2, 31) and apart.max() < 0.1
