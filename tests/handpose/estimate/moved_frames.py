"""How far joints move between sets of BLAS kernels, which OpenBLAS selects by processor.

    python -m tests.handpose.estimate.moved_frames --frames 100      the figures of docs/reliability.md

The frames of tools/demo.py are predicted in one process for each set; Nehalem's with NumPy's SIMD off as well.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
from collections.abc import Sequence

import numpy as np

from netlib.files.paths import ROOT

KERNELS = ("SkylakeX", "Haswell", "SandyBridge", "Nehalem")
LIMITS_MM = (0.1, 1, 5)
SCRIPT = """
import json
import sys
import netlib
from handpose.estimate.packaged import load_predictor
from tools.demo import scene
count, seed, fits = json.loads(sys.argv[1])
depth = [scene(seed + n)[0] for n in range(count)]
for fit in fits:
    predictor = load_predictor(fit=fit, min_confidence=0)
    hands = [predictor.in_frame(frame) for frame in depth]
    print(json.dumps([hand.xyz.tolist() for hand in hands]))
"""


def simd_extensions() -> list[str]:
    """The optional instruction sets that NumPy uses on this processor."""
    core = importlib.import_module(f"numpy.{'_core' if np.__version__ >= '2' else 'core'}._multiarray_umath")
    return [name for name in core.__cpu_dispatch__ if core.__cpu_features__[name]]


def joints(kernels: str, count: int, seed: int, fits: Sequence[str]) -> np.ndarray:
    """(fits, frames, K, 3) mm, with these kernels. Other BLAS libraries than OpenBLAS ignore the choice."""
    environment = os.environ | {"OPENBLAS_CORETYPE": kernels}
    if kernels == "Nehalem":
        environment["NPY_DISABLE_CPU_FEATURES"] = " ".join(simd_extensions())
    command = [sys.executable, "-c", SCRIPT, json.dumps([count, seed, fits])]
    done = subprocess.run(command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return np.array([json.loads(line) for line in done.stdout.splitlines()])


def moves(found: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """(fits, frames) mm: the largest move of any joint between any two sets of kernels."""
    pairs = [np.linalg.norm(a - b, axis=-1).max(axis=-1) for i, a in enumerate(found) for b in found[:i]]
    return np.max(pairs, axis=0)


def main(argv: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--seed", type=int, default=9)
    parser.add_argument("--kernels", nargs="+", default=KERNELS, choices=KERNELS, help="default: all")
    args = parser.parse_args(argv)
    fits = ("accurate", "fast")
    found = [joints(kernels, args.frames, args.seed, fits) for kernels in args.kernels]
    print("| fit | frames |", *(f"> {limit:g} mm |" for limit in LIMITS_MM), "largest |")
    print("|---|" + "---|" * (len(LIMITS_MM) + 2))
    for fit, moved in zip(fits, moves(found)):
        counts = " | ".join(str((moved > limit).sum()) for limit in LIMITS_MM)
        print(f"| `{fit}` | {len(moved)} | {counts} | {moved.max():.2g} mm |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
