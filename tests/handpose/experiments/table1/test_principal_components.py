"""handpose/experiments/table1/principal_components.py; more of it in the tests of tools/table1.py"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from handpose.experiments.table1.principal_components import write_components
from handpose.synthetic.generator import Generator


def test_thirty_components_are_nearly_all_of_a_hand(tmp_path: Path) -> None:
    """Of 64 hands of all sizes, 2 mm per joint are lost; the numbers of the bottleneck have unit size."""
    joints = Generator(0).block(0).joint.astype(np.float64)
    for n, some in enumerate(np.array_split(joints, 2)):
        with h5py.File(tmp_path / f"{n}.h5", "w") as file:
            file["joint"] = some
    write_components(tmp_path / "components.caffemodel.h5", [tmp_path / "0.h5", tmp_path / "1.h5"])
    with h5py.File(tmp_path / "components.caffemodel.h5") as file:
        basis, mean = file["data/joints/0"][...].astype(np.float64), file["data/joints/1"][...]
    assert basis.shape == (93, 30) and mean == pytest.approx(joints.mean(axis=0), abs=1e-6)
    numbers = (joints - mean) @ np.linalg.pinv(basis).T
    assert numbers.std(axis=0) == pytest.approx(np.ones(30), abs=1e-3)
    lost = np.linalg.norm((numbers @ basis.T + mean - joints).reshape(-1, 31, 3), axis=2) * 150
    assert lost.mean() < 2.5
    assert np.linalg.norm((joints - mean).reshape(-1, 31, 3), axis=2).mean() * 150 > 30, "without them"
