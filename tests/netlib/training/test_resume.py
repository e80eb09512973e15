"""Resuming from a solver state of an earlier version, of the other engine and of the same one."""

from __future__ import annotations

import copy
import dataclasses
import os
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from netlib import engine
from netlib.snapshots import hdf5_format, snapshot
from netlib.snapshots.solver_state import SolverState
from tests.netlib.conftest import RECORDINGS, MakeSolver, everything, furnish

pytestmark = pytest.mark.both_engines


@pytest.fixture
def older(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    furnish(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def after_3(engine_in_use: str | None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the state after three iterations in the engine in use."""
    folder = tmp_path_factory.mktemp("after_3")
    furnish(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert netlib.get_solver(
            "solver.prototxt", seed=1, max_iter=3, snapshot_format="HDF5"
        ).solve()
    return folder


@pytest.fixture
def state_3(older: Path, after_3: Path) -> Path:
    """The state after three iterations, in the working directory."""
    shutil.copytree(after_3, older, dirs_exist_ok=True)
    return Path("older_iter_3.solverstate.h5")


def weights(solver: netlib.Solver) -> dict[str, np.ndarray]:
    return {p.label.replace("/", "_"): p.blob.data.copy() for p in solver.net.learnable}


def distance(got: dict[str, np.ndarray], want: dict[str, np.ndarray]) -> float:
    return max(float(np.abs(got[name] - want[name]).max()) for name in got)


@pytest.mark.parametrize(
    ("name", "crc32"),
    [
        ("older_iter_5.solverstate.h5", [233770473, 1782572153]),
        ("checked_iter_5.solverstate.h5", [1909220512, 2251532900]),
        ("checked_iter_5.solverstate", [1909220512, 2251532900]),
    ],
)
def test_a_state_of_an_earlier_version_goes_on(older: Path, name: str, crc32: list[int]) -> None:
    """States of version 0.1.0, without a checksum, and of before the seal, with one of their
    content only, are read to the bit, and resume with their rows, masks, momentum and
    losses, to rounding.
    """
    state = snapshot.read_state(name)
    layers = snapshot.read_weights(snapshot.weights_of(name, state))
    arrays = [array for own in layers.values() for _, array in sorted(own.items())]
    assert [
        zlib.crc32(b"".join(array.tobytes() for array in found))
        for found in (arrays, state.history)
    ] == crc32
    solver = netlib.get_solver("solver.prototxt", seed=99)
    assert solver.solve(name)
    recorded = dict(np.load("after_12.npz"))
    smoothed = recorded.pop("smoothed")
    assert solver.iter == 12
    assert distance(weights(solver), recorded) <= 1e-6
    assert np.allclose(list(solver.smoothed), smoothed, rtol=1e-5)


@pytest.mark.skipif(not engine.has_fast(), reason="the folder fast/ is not there")
@pytest.mark.parametrize("names", [("plain", "fast"), ("fast", "plain")], ids="-".join)
def test_a_state_of_the_other_engine_goes_on(older: Path, names: tuple[str, str]) -> None:
    """A state of one engine resumes on the other with the same rows and masks; results differ by
    rounding only.
    """
    writer, reader = names
    first = netlib.get_solver("solver.prototxt", engine=writer)
    assert first.solve()
    second = netlib.get_solver("solver.prototxt", engine=reader, seed=99)
    assert second.solve("older_iter_5.solverstate.h5")
    assert 0 <= distance(weights(second), weights(first)) <= 1e-6


IMAGES = """
    layer { name: "x" type: "DummyData" top: "x" top: "y" dummy_data_param { shape { dim: 150 dim: 3 dim: 24 dim: 24 }
            shape { dim: 150 } data_filler { type: "gaussian" } data_filler { value: 1 } } }
    layer { name: "c" type: "Convolution" bottom: "x" top: "c"
            convolution_param { num_output: 4 kernel_size: 3 weight_filler { type: "msra" } } }
    layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 2 stride: 2 } }
    layer { name: "f" type: "InnerProduct" bottom: "p" top: "f" inner_product_param { num_output: 4 } }
    layer { name: "l" type: "SoftmaxWithLoss" bottom: "f" bottom: "y" top: "l" }
"""


@pytest.mark.parametrize("looks", ["debug_info", "a callback", "before the resume", ""])
def test_a_resume_is_exact_whatever_was_looked_at(solver_of: MakeSolver, looks: str) -> None:
    """A look at a blob that the fast engine does not store changes the rounding, so a state has
    what is stored.
    """

    def make() -> netlib.Solver:
        solver = solver_of(
            IMAGES, f"display: 2 debug_info: {str(looks == 'debug_info').lower()} random_seed: 1"
        )
        if looks == "a callback":
            solver.add_callback(
                lambda: None, lambda: solver.iter == 3 and solver.net.blobs["c"].diff
            )
        return solver

    one, other = make(), make()
    one.step(5)
    state = one.snapshot()
    one.step(3)
    if looks == "before the resume":
        other.net.blobs["c"].data  # noqa: B018
    other.restore(state)
    other.step(3)
    assert everything(other) == everything(one)


def changed(path: Path, **fields: Any) -> None:
    """Rewrite a state with other fields and a correct checksum."""
    state = snapshot.read_state(path)
    extra = {**state.extra, **fields.pop("extra", {})}
    state = dataclasses.replace(state, extra=extra, **fields)
    state.extra["checksum"] = state.checksum()
    path.write_bytes(hdf5_format.state_image(state))


def of_layers(number: int, name: str, **fields: Any) -> Callable[[SolverState], dict[str, Any]]:
    """Return a change to the state of one layer of one net."""

    def change(state: SolverState) -> dict[str, Any]:
        layers = copy.deepcopy(state.extra["layers"])
        layers[number][name].update(fields)
        return {"extra": {"layers": layers}}

    return change


DAMAGE: dict[str, tuple[Callable[[SolverState], dict[str, Any]], str]] = {
    "an iteration below 0": (lambda state: {"iter": -1}, "iter is -1"),
    "text as a history": (
        lambda state: {"history": [np.array([b"x"]), *state.history[1:]]},
        "history 0 holds |S1",
    ),
    "complex numbers": (
        lambda state: {"history": [h.astype(complex) for h in state.history]},
        "holds complex128",
    ),
    "NaN": (
        lambda state: {"history": [h * np.nan for h in state.history]},
        "has values that are not finite",
    ),
    "another shape": (
        lambda state: {"history": [h[..., None] for h in state.history]},
        "history 0 has shape",
    ),
    "a history too few": (
        lambda state: {"history": state.history[1:]},
        "histories, but SGD on this net has",
    ),
    "numbers beyond float32": (
        lambda state: {"history": [np.full(h.shape, 1e300) for h in state.history]},
        "too large for float32",
    ),
    "unknown fields": (
        lambda state: {"extra": {"solvex": {}}},
        "found 'solvex', expected solver, smoothed",
    ),
    "a row that is not there": (
        of_layers(0, "data", cursor=[0, 0, 10**9]),
        "there is no row at [0, 0, 1000000000]",
    ),
    "a file that is not there": (of_layers(0, "data", cursor=[0, 7, 0]), "cannot be restored"),
    "a cursor of two": (
        of_layers(0, "data", cursor=[0, 0]),
        "cannot be restored: not enough values",
    ),
    "a seed below 0": (of_layers(0, "data", seed=-1), "cannot be restored"),
    "no random numbers": (
        of_layers(0, "drop", rng={"bit_generator": "SFC64"}),
        "cannot be restored",
    ),
    "numbers of 70 bits": (
        of_layers(
            0,
            "drop",
            rng={
                "bit_generator": "SFC64",
                "state": {"state": [2**70] * 4},
                "has_uint32": 0,
                "uinteger": 0,
            },
        ),
        "cannot be restored",
    ),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_state_changes_nothing(state_3: Path, name: str) -> None:
    change, message = DAMAGE[name]
    changed(state_3, **change(snapshot.read_state(state_3)))
    solver = netlib.get_solver("solver.prototxt", seed=99)
    solver.step(2)
    before = everything(solver)
    with pytest.raises(netlib.WeightsError) as error:
        solver.restore(state_3)
    assert message in str(error.value)
    assert everything(solver) == before


def test_layers_without_a_state_are_reported(
    state_3: Path, caplog: pytest.LogCaptureFixture
) -> None:
    layers = copy.deepcopy(snapshot.read_state(state_3).extra["layers"])
    del layers[0]["drop"]
    changed(state_3, extra={"layers": layers})
    caplog.set_level("INFO", "netlib")
    netlib.get_solver("solver.prototxt").restore(state_3)
    assert "Changed: the layers; there is no state of 'drop' in net" in caplog.text
    assert "the resume is exact" not in caplog.text


def test_values_missing_in_a_state_of_an_earlier_version_are_reported(
    older: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The state has no checksum; an option that it lacks had its default."""
    caplog.set_level("INFO", "netlib")
    netlib.get_solver("solver.prototxt", rampup_interval=8).restore("older_iter_5.solverstate.h5")
    assert "without a checksum" in caplog.text
    assert "Changed: rampup_interval was 0, is now 8" in caplog.text


def test_a_finished_training_is_reported(older: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert netlib.get_solver("solver.prototxt", max_iter=5).solve("older_iter_5.solverstate.h5")
    assert "Nothing is left to train: max_iter is 5" in caplog.text


WITH_TESTS: dict[str, Any] = {
    "test_iter": (3,),
    "test_interval": 4,
    "snapshot_prefix": "run",
    "snapshot_format": "HDF5",
}


def interrupt(solver: netlib.Solver, net: netlib.Net, happens: Callable[[], object]) -> None:
    """Call ``happens`` before the second batch of a net in iteration 8."""
    run, batches = net.run_forward, list[int]()

    def interrupted() -> float:
        batches.append(solver.iter)
        if batches.count(8) == 2:
            happens()
        return run()

    net.run_forward = interrupted  # type: ignore[method-assign]


def test_a_stop_within_a_test_resumes_exactly(older: Path) -> None:
    """A test that was stopped is repeated from the same row, so the results equal those of an
    uninterrupted run.
    """
    whole = netlib.get_solver("solver.prototxt", **WITH_TESTS)
    assert whole.solve()
    broken = netlib.get_solver("solver.prototxt", **WITH_TESTS)
    interrupt(broken, broken.test_nets[0], lambda: setattr(broken, "requested", "stop"))
    assert not broken.solve()
    resumed = netlib.get_solver("solver.prototxt", seed=99, **WITH_TESTS)
    assert resumed.solve("run_iter_8.solverstate.h5")
    assert everything(resumed) == everything(whole)


ROWS = ("train0.h5", "train1.h5")


def copy_rows() -> None:
    for name in ROWS:
        shutil.copy(RECORDINGS / name, name)


@pytest.mark.parametrize("within", ["training", "a test"])
def test_data_that_are_cut_on_the_way(older: Path, within: str) -> None:
    """If a data file is truncated, training ends with an error and a snapshot, from which the
    resume is exact.
    """
    # changes with every batch
    norm = 'layer { name: "norm" type: "BatchNorm" bottom: "pool" top: "pool" }\n'
    net_file, relu = Path("net.prototxt"), 'layer { name: "relu"'
    net_file.write_text(net_file.read_text().replace(relu, norm + relu))
    copy_rows()
    Path("list.txt").write_text("train0.h5\ntrain1.h5\n")
    whole = netlib.get_solver("solver.prototxt", iter_size=2, **WITH_TESTS)
    assert whole.solve()
    broken = netlib.get_solver(
        "solver.prototxt", iter_size=2, snapshot_after_train=within == "a test", **WITH_TESTS
    )
    net = broken.net if within == "training" else broken.test_nets[0]
    interrupt(broken, net, lambda: [os.truncate(name, 100) for name in ROWS])
    with pytest.raises(
        netlib.DataError, match=r"train[01]\.h5: was cut to 100 of \d+ bytes while in use"
    ):
        broken.solve()
    copy_rows()
    stop = broken.iter
    assert stop in (8, 9)
    resumed = netlib.get_solver("solver.prototxt", iter_size=2, seed=99, **WITH_TESTS)
    assert resumed.solve(f"run_iter_{stop}.solverstate.h5")
    assert everything(resumed) == everything(whole)
