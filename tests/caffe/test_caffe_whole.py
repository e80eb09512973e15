"""The recordings of this folder agree with the whole ones, and netlib also agrees with the parts
left out here.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.caffe.recorded import (
    FOLDER,
    Array,
    Case,
    differences,
    layer_cases,
    solver_cases,
    trajectory,
)


def test_every_number_is_one_that_caffe_recorded(whole: Path) -> None:
    """The layer cases and the trajectories equal the whole recordings, bit for bit; other
    files are copies.
    """
    made = ("layers.json", "layers.h5", "hdf5data.npz", "trajectories.h5")  # from these recordings
    for path in sorted(FOLDER.rglob("*")):
        if path.is_file() and path.suffix not in (".py", ".pyc", ".md") and path.name not in made:
            assert path.read_bytes() == (whole / path.relative_to(FOLDER)).read_bytes(), path
    stacked, batches = (np.load(folder / "hdf5data/hdf5data.npz") for folder in (FOLDER, whole))
    for key, array in stacked.items():
        assert all(np.array_equal(batch, batches[f"{key}/{i}"]) for i, batch in enumerate(array)), (
            key
        )
    recorded = dict(np.load(whole / "layers.npz"))
    for case in layer_cases():
        assert case.prototxt == (whole / f"layers/{case.name}.prototxt").read_text()
        for part, array in case.arrays.items():
            key = f"{case.name}/{part}"
            assert recorded[key][array.kept].tobytes() == array.single.tobytes()
            assert (array.double is not None) == (f"{key}_f64" in recorded)
            if array.double is not None:
                assert recorded[f"{key}_f64"][array.kept].tobytes() == array.double.tobytes()
    assert (
        sum(len(case.arrays) for case in layer_cases())
        == sum("_f64" not in key for key in recorded) - 2
    )
    for name in solver_cases():
        steps = np.load(whole / f"solvers/traj_{name}.npz")
        ours = trajectory(name)
        assert np.array_equal(ours.losses, steps["loss_last_subbatch"])
        assert np.array_equal(ours.printed_losses, steps["loss_printed"])
        assert np.array_equal(ours.printed_rates, steps["lr_printed"])
        for (layer, index), after in ours.weights.items():
            assert all(
                np.array_equal(array, steps[f"w/{layer}/{index}"][i]) for i, array in after.items()
            )


@pytest.mark.both_engines
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1e-5), (np.float64, 1e-12)])
def test_the_large_layer_cases_agree_in_whole(whole: Path, dtype: Any, tolerance: float) -> None:
    """The large layer cases agree in full, including the parts that a clone does not have."""
    recorded = dict(np.load(whole / "layers.npz"))
    names = {
        case.name
        for case in layer_cases()
        if any(array.kept is not ... for array in case.arrays.values())
    }
    assert len(names) == 4
    for entry in json.loads((whole / "layers_index.json").read_text()):
        name = entry["case"]
        if name in names:
            keys = [
                key for key in recorded if key.startswith(f"{name}/") and not key.endswith("_f64")
            ]
            arrays = {
                key.removeprefix(f"{name}/"): Array(
                    recorded[key].shape, ..., recorded[key], recorded.get(f"{key}_f64")
                )
                for key in keys
            }
            text = (whole / f"layers/{name}.prototxt").read_text()
            case = Case(
                name,
                ("TRAIN", "TEST").index(entry["phase"]),
                entry["backward"],
                frozenset(),
                text,
                arrays,
            )
            found = differences(case, dtype)
            assert len(found) == case.results(dtype) >= 2
            assert all(far <= tolerance for far in found.values()), found
