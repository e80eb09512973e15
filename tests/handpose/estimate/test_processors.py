"""Hands in frames do not depend on the BLAS kernels, which OpenBLAS selects by processor."""

from __future__ import annotations

import re

import numpy as np

from tests.handpose.estimate import moved_frames
from tests.support.running import run_tool


def test_kernels() -> None:
    """The joints agree to 0.1 mm for two sets of kernels and every fit."""
    done = run_tool("tests.handpose.estimate.moved_frames", "--frames", "1", "--kernels", "Haswell", "Nehalem")
    largest = re.findall(r"^\| `(\w+)` \| 1 \| .* \| (\S+) mm \|$", done.out, re.MULTILINE)
    assert [fit for fit, _ in largest] == ["accurate", "fast"]
    assert max(float(moved) for _, moved in largest) < 0.1


def test_moves() -> None:
    """The result is the largest move of a frame's joints between any two sets."""
    found = np.zeros((3, 1, 2, 31, 3))
    found[2, 0, 1, 7] = 3, 0, 4
    assert moved_frames.moves(found).tolist() == [[0, 5]]
