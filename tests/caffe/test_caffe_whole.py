"""The recordings of this folder agree with the whole ones, and netlib also agrees with the parts left out here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import netlib
from tests.caffe import reduce
from tests.caffe.recorded import (
    FOLDER,
    Array,
    Case,
    Follow,
    Trajectory,
    differences,
    layer_cases,
    solver_cases,
    trajectory,
)


def test_the_recordings_are_small() -> None:
    """All files that are not written by hand have less than 3 MB together."""
    files = [path for path in FOLDER.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc", ".md")]
    assert sum(path.stat().st_size for path in files) <= reduce.LIMIT


def test_every_number_is_one_that_caffe_recorded(whole: Path, tmp_path: Path) -> None:
    """reduce.py reproduces the files of this folder; their arrays equal those of the whole recordings, bit for bit."""
    reduce.main(whole, tmp_path)
    made = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file())
    assert len(made) > 60
    for path in made:
        mine, again = contents(FOLDER / path), contents(tmp_path / path)
        assert mine.keys() == again.keys(), path
        assert all(mine[key] == again[key] for key in mine), path
    recorded = dict(np.load(whole / "layers.npz"))
    for case in layer_cases():
        for part, array in case.arrays.items():
            key = f"{case.name}/{part}"
            assert recorded[key][array.kept].tobytes() == array.single.tobytes()
            assert (array.double is not None) == (f"{key}_f64" in recorded)
            if array.double is not None:
                assert recorded[f"{key}_f64"][array.kept].tobytes() == array.double.tobytes()
    assert sum(len(case.arrays) for case in layer_cases()) == sum("_f64" not in key for key in recorded) - 2
    for name in solver_cases():
        steps = np.load(whole / f"solvers/traj_{name}.npz")
        for (layer, index), after in trajectory(name).weights.items():
            assert all(np.array_equal(array, steps[f"w/{layer}/{index}"][i]) for i, array in after.items())


def contents(path: Path) -> dict[str, Any]:
    """Return the contents of a file; compressed arrays as numbers, since their bytes depend on the compressor."""
    if path.suffix == ".npz":
        return {key: array.tobytes() for key, array in np.load(path).items()}
    if path.name not in ("layers.h5", "trajectories.h5"):
        return {"": path.read_bytes()}
    with h5py.File(path) as file:
        found = {"cases": file["cases"][()].tolist()} if "cases" in file else {}
        for key in (key for key in keys_of(file) if key != "cases"):
            found[key] = (file[key][...].tobytes(), list(file[key].attrs.get("iterations", [])))
        return found


def keys_of(file: h5py.File) -> list[str]:
    """Return the names of all arrays."""
    keys: list[str] = []
    file.visititems(lambda name, item: keys.append(name) if isinstance(item, h5py.Dataset) else None)
    return keys


@pytest.mark.both_engines
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1e-5), (np.float64, 1e-12)])
def test_the_large_layer_cases_agree_in_whole(whole: Path, dtype: Any, tolerance: float) -> None:
    """The large layer cases agree in full, including the parts that a clone does not have."""
    recorded = dict(np.load(whole / "layers.npz"))
    names = {key.split("/")[0] for key in reduce.KEPT}
    assert len(names) == 4
    for entry in json.loads((whole / "layers_index.json").read_text()):
        name = entry["case"]
        if name in names:
            keys = [key for key in recorded if key.startswith(f"{name}/") and not key.endswith("_f64")]
            arrays = {
                key.removeprefix(f"{name}/"): Array(recorded[key].shape, ..., recorded[key], recorded.get(f"{key}_f64"))
                for key in keys
            }
            text = (whole / f"layers/{name}.prototxt").read_text()
            case = Case(name, ("TRAIN", "TEST").index(entry["phase"]), entry["backward"], frozenset(), text, arrays)
            found = differences(case, dtype)
            assert len(found) == case.results(dtype) >= 2
            assert all(far <= tolerance for far in found.values()), found


@pytest.mark.both_engines
def test_all_weights_agree_after_every_update(whole: Path, solvers: Path) -> None:
    """All weights agree after every update, including the largest, of which a clone has three iterations of twenty."""
    for name in solver_cases():
        recorded = np.load(whole / f"solvers/traj_{name}.npz")
        weights = {
            (layer, index): dict(enumerate(recorded[f"w/{layer}/{index}"])) for layer, index in trajectory(name).weights
        }
        losses = recorded["loss_last_subbatch"]
        solver = netlib.get_solver(f"solver_{name}.prototxt", snapshot=0, display=0)
        solver.copy_weights("init.caffemodel.h5")
        follow = Follow(solver, Trajectory(weights, losses, recorded["loss_printed"], recorded["lr_printed"]))
        solver.step(20)
        assert follow.compared == 6 * 20
        assert follow.worst <= 1e-5, name
        assert follow.worst_loss <= 1e-5, name
