"""Hands in frames do not depend on the BLAS kernels, which OpenBLAS chooses by the processor."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np

from netlib.files.paths import ROOT

SCRIPT = """
import json
import netlib
import numpy as np
from handpose.prediction.packaged import load_predictor
from handpose.synthetic.scenes import draw_scenes
depth = np.rint(draw_scenes(np.random.default_rng(9), 2).depth).astype(np.uint16)
found = [load_predictor(fit=fit).in_frame(frame) for fit in ("fast", "accurate") for frame in depth]
print(json.dumps([hand.xyz.tolist() for hand in found]))
"""


def test_kernels() -> None:
    """The joints agree to 0.1 mm. Other BLAS libraries than OpenBLAS ignore the variable."""
    found = []
    for kernels in ("Haswell", "Nehalem"):
        done = subprocess.run([sys.executable, "-c", SCRIPT], env=os.environ | {"OPENBLAS_CORETYPE": kernels}, cwd=ROOT,
                              capture_output=True, text=True, check=True)  # fmt: skip
        found.append(np.array(json.loads(done.stdout)))
    assert found[0].shape == (4, 31, 3)
    assert np.linalg.norm(found[0] - found[1], axis=2).max() < 0.1
