"""The large layer cases, of which a clone has parts, compared with real Caffe in whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.caffe.recorded import Array, Case, differences, layer_cases

LARGE = [
    case for case in layer_cases() if any(array.kept is not ... for array in case.arrays.values())
]


def in_whole(case: Case, recorded: dict[str, np.ndarray]) -> Case:
    """Return the case with all arrays that were recorded, also those that a clone does not have."""
    arrays = {}
    for key, single in recorded.items():
        name, _, part = key.partition("/")
        if name == case.name and not key.endswith("_f64"):
            arrays[part] = Array(single.shape, ..., single, recorded.get(f"{key}_f64"))
    return replace(case, arrays=arrays)


@pytest.mark.both_engines
@pytest.mark.parametrize("case", LARGE, ids=lambda case: case.name)
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1e-5), (np.float64, 1e-12)])
def test_the_large_layer_cases_agree_in_whole(
    whole: Path, case: Case, dtype: Any, tolerance: float
) -> None:
    case = in_whole(case, dict(np.load(whole / "layers.npz")))
    found = differences(case, dtype)
    assert len(found) == case.results(dtype) >= 2
    assert all(far <= tolerance for far in found.values()), found
