"""Going on from a solver state: one of an earlier version, one of the other engine, one of the same."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib import engine

OLDER = Path(__file__).parent / "older"
RECORDINGS = Path(__file__).resolve().parents[1] / "caffe" / "solvers"


@pytest.fixture
def older(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: a small net with shuffled data and dropout, and a state that version 0.1.0 wrote of it."""
    shutil.copytree(OLDER, tmp_path, dirs_exist_ok=True)
    (tmp_path / "list.txt").write_text(f"{RECORDINGS}/train0.h5\n{RECORDINGS}/train1.h5\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def weights(solver: netlib.Solver) -> dict[str, np.ndarray]:
    """Copies of all parameters."""
    return {p.label.replace("/", "_"): p.blob.data.copy() for p in solver.net.learnable}


def distance(got: dict[str, np.ndarray], want: dict[str, np.ndarray]) -> float:
    """The largest difference."""
    return max(float(np.abs(got[name] - want[name]).max()) for name in got)


def test_a_state_of_an_earlier_version_goes_on(older: Path) -> None:
    """With the rows, dropout masks, momentum and averaged loss that it had: as that version went on, to rounding."""
    solver = netlib.get_solver("solver.prototxt", seed=99)
    assert solver.solve("older_iter_5.solverstate.h5")
    recorded = dict(np.load("after_12.npz"))
    smoothed = recorded.pop("smoothed")
    assert solver.iter == 12
    assert distance(weights(solver), recorded) <= 1e-6
    assert np.allclose(list(solver.smoothed), smoothed, rtol=1e-5)


@pytest.mark.parametrize(("format", "suffix"), [("HDF5", ".h5"), ("BINARYPROTO", "")])
def test_a_resume_is_exact(older: Path, format: str, suffix: str) -> None:
    """Seven iterations after a resume are the last seven of twelve, bit for bit, in both formats."""
    whole = netlib.get_solver("solver.prototxt", snapshot_format=format)
    assert whole.solve()
    resumed = netlib.get_solver("solver.prototxt", seed=99)
    assert resumed.solve(f"older_iter_5.solverstate{suffix}")
    assert distance(weights(resumed), weights(whole)) == 0


@pytest.mark.skipif(not engine.has_fast(), reason="the folder fast/ is not there")
@pytest.mark.parametrize("names", [("plain", "fast"), ("fast", "plain")], ids="-".join)
def test_a_state_of_the_other_engine_goes_on(older: Path, names: tuple[str, str]) -> None:
    """The same rows and masks; only the rounding is another."""
    writer, reader = names
    first = netlib.get_solver("solver.prototxt", engine=writer)
    assert first.solve()
    second = netlib.get_solver("solver.prototxt", engine=reader, seed=99)
    assert second.solve("older_iter_5.solverstate.h5")
    assert 0 <= distance(weights(second), weights(first)) <= 1e-6


@pytest.mark.skipif(not engine.has_fast(), reason="the folder fast/ is not there")
def test_both_engines_read_the_same_rows_and_draw_the_same_masks(older: Path) -> None:
    """Batch after batch; and after a step both leave the same gradient."""
    solvers = [netlib.get_solver("solver.prototxt", engine=name, seed=4) for name in ("plain", "fast")]
    for _ in range(4):
        for solver in solvers:
            solver.step(1)
        plain, fast = (solver.net for solver in solvers)
        assert np.array_equal(plain.blobs["data"].data, fast.blobs["data"].data)
        assert np.array_equal(plain.blobs["ip1"].data == 0, fast.blobs["ip1"].data == 0)
        for one, other in zip(plain.learnable, fast.learnable):
            assert np.allclose(one.blob.diff, other.blob.diff, rtol=1e-4, atol=1e-6), one.label
