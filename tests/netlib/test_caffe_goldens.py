"""Every number recorded from real Caffe: layers, the hand, data order, solvers, a whole training."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import netlib
from netlib import snapshot
from netlib.net_parameter import load_parameter
from netlib.updates import learning_rate

Recorded = dict[str, np.ndarray]
BOTH = pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1e-5), (np.float64, 1e-12)])


def relative(got: Any, want: Any) -> float:
    """max |got - want| / max |want|; infinite if they differ in where they are finite."""
    want = np.asarray(want, np.float64)
    got = np.asarray(got, np.float64).reshape(want.shape)
    finite = np.isfinite(want)
    if not np.array_equal(np.isfinite(got), finite):
        return np.inf
    return float(np.abs(got - want)[finite].max(initial=0) / max(np.abs(want)[finite].max(initial=0), 1e-30))


def distance(got: Any, want: Any) -> float:
    """||got - want|| / ||want||."""
    return float(np.linalg.norm(got - want) / max(np.linalg.norm(want), 1e-30))


# ---------------------------------------------------------------------------------------------- layers


def parts_of(recorded: Recorded, case: str, kind: str, dtype: Any) -> Iterator[tuple[list[str], np.ndarray]]:
    """The arrays ``CASE/KIND/...``, as recorded from Caffe's nets of this type."""
    for key, array in recorded.items():
        name, found, *rest = key.removesuffix("_f64").split("/")
        if (name, found, key.endswith("_f64")) == (case, kind, dtype == np.float64):
            yield rest, array


def check_layer_case(folder: Path, recorded: Recorded, case: dict[str, Any], dtype: Any) -> list[float]:
    """The differences of all arrays of one case, forward and backward."""
    name = case["case"]
    net = netlib.Net(folder / f"layers/{name}.prototxt", ("TRAIN", "TEST").index(case["phase"]), dtype=dtype)
    for (layer, index), array in parts_of(recorded, name, "param", np.float32):
        net.params[layer][int(index)].data[...] = array
    for (blob,), array in parts_of(recorded, name, "in", np.float32):
        net.blobs[blob].data[...] = array
    net.forward()
    found = [relative(net.blobs[blob].data, want) for (blob,), want in parts_of(recorded, name, "top", dtype)]
    if case["backward"]:
        for (blob,), array in parts_of(recorded, name, "topdiff", np.float32):
            net.blobs[blob].diff[...] = array
        net.backward()
        for (blob,), want in parts_of(recorded, name, "indiff", dtype):
            found.append(relative(net.blobs[blob].diff, want))
        for (layer, index), want in parts_of(recorded, name, "pdiff", dtype):
            found.append(relative(net.params[layer][int(index)].diff, want))
    return found


@BOTH
def test_every_recorded_layer_case_agrees_forward_and_backward(caffe_data: Path, dtype: Any, tolerance: float) -> None:
    """All 85 cases whose layer types are here."""
    recorded = dict(np.load(caffe_data / "layers.npz"))
    known, ran, compared, wrong = set(netlib.layer_type_list()), 0, 0, {}
    for case in json.loads((caffe_data / "layers_index.json").read_text()):
        types = {layer.type for layer in load_parameter(caffe_data / f"layers/{case['case']}.prototxt").layer}
        if types <= known:
            differences = check_layer_case(caffe_data, recorded, case, dtype)
            ran, compared = ran + 1, compared + len(differences)
            if not all(d <= tolerance for d in differences):
                wrong[case["case"]] = differences
    assert wrong == {}
    assert ran >= 85
    assert compared >= 230


# ---------------------------------------------------------------------------------------------- the hand


HAND = """
    force_backward: true
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 32 dim: 47 } } }
    layer { name: "hand" type: "%s" bottom: "x" top: "y" }
"""


@pytest.mark.parametrize("type_name", ["HandModel", "DeepHandModel"])
@pytest.mark.parametrize(("dtype", "suffix", "tolerance"), [(np.float32, "", 5e-6), (np.float64, "_f64", 1e-12)])
def test_hand_model(
    caffe_data: Path, net_of: Callable[..., netlib.Net], type_name: str, dtype: Any, suffix: str, tolerance: float
) -> None:
    """Joints and gradients of 32 poses, under our name and the released one.

    Some of them turn by 900 rad, where neighbouring float32 numbers are 6e-5 rad apart.
    """
    recorded = np.load(caffe_data / "hand_model.npz")
    net = net_of(HAND % type_name, dtype=dtype)
    net.forward(x=recorded["bottom"])
    net.backward(y=recorded["top_diff"])
    usual = (np.abs(recorded["bottom"]) < 7).all(axis=1)
    assert usual.sum() >= 20
    for rows, within in ((slice(None), tolerance), (usual, tolerance / 5)):
        assert relative(net.blobs["y"].data[rows], recorded["top" + suffix][rows]) <= within
        assert relative(net.blobs["x"].diff[rows], recorded["bottom_diff" + suffix][rows]) <= within


@pytest.mark.parametrize("layer", ['"DeepHandModelDofConstraintLoss"', '"PhysLimit" phys_limit_param { norm: L2 }'])
def test_phys_limit(caffe_data: Path, net_of: Callable[..., netlib.Net], layer: str) -> None:
    """The squared hinge of 64 poses. Caffe leaves the diffs of fixed DoFs unwritten; ours are 0."""
    recorded = np.load(caffe_data / "phys_limit.npz")
    net = net_of(
        'force_backward: true layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 64 dim: 47 } } }'
        f'layer {{ name: "limit" bottom: "x" top: "loss" type: {layer} }}'
    )
    net.forward(x=recorded["bottom"])
    net.backward()
    free = [*range(6), *range(15, 19), *range(31, 47)]
    assert relative(net.blobs["loss"].data, recorded["loss_w1"]) <= 1e-6
    assert relative(net.blobs["x"].diff[:, free], recorded["bottom_diff_w1"][:, free]) <= 1e-6
    assert not np.delete(net.blobs["x"].diff, free, axis=1).any()


# ---------------------------------------------------------------------------------------------- data


def test_hdf5_data_reads_rows_in_caffes_order(caffe_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without shuffle: batches that run on over file ends, wrap, and are larger than the data."""
    monkeypatch.chdir(caffe_data / "hdf5data")
    recorded = np.load("hdf5data.npz")
    ran = 0
    for case in json.loads(Path("index.json").read_text()):
        if "shuffle" in case["extra"]:
            continue
        net = netlib.Net(f"{case['case']}.prototxt", netlib.TRAIN)
        for i in range(case["iters"]):
            for blob, array in net.forward().items():
                assert np.array_equal(array, recorded[f"{case['case']}/{blob}/{i}"]), (case["case"], blob, i)
        ran += 1
    assert ran == 6


@pytest.mark.parametrize("case", ["shuffle_b7", "shuffle_one_b7"])
def test_hdf5_data_shuffles_files_and_the_rows_of_a_file(
    caffe_data: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    """Every pass is a permutation file by file, in what Caffe recorded and in what we read."""
    monkeypatch.chdir(caffe_data / "hdf5data")
    index = {entry["case"]: entry for entry in json.loads(Path("index.json").read_text())}[case]
    recorded = np.load("hdf5data.npz")
    files = {}
    for name in Path(index["source"]).read_text().split():
        with h5py.File(name) as file:
            files[name] = [float(v) for v in np.ravel(file["label"])]
    theirs = np.concatenate([recorded[f"{case}/label/{i}"] for i in range(index["iters"])])
    net = netlib.Net(f"{case}.prototxt", netlib.TRAIN, seed=3)
    ours = np.concatenate([net.forward()["label"].copy() for _ in range(40)])
    size = sum(map(len, files.values()))
    passes = [[float(v) for v in rows[i : i + size]] for rows in (theirs, ours) for i in range(0, len(rows), size)]
    for rows in passes:
        check_pass(rows, list(files.values()))
    complete = {tuple(rows) for rows in passes if len(rows) == size}
    assert len(complete) > 5, "passes must differ"


def check_pass(rows: list[float], files: list[list[float]]) -> None:
    """One pass reads each file once, all rows of a file before those of the next."""
    left = [sorted(rows) for rows in files]
    while rows:
        mine = next(file for file in left if rows[0] in file)
        head, rows = rows[: len(mine)], rows[len(mine) :]
        assert sorted(head) == mine or (not rows and set(head) <= set(mine) and len(set(head)) == len(head))
        left.remove(mine)


# ---------------------------------------------------------------------------------------------- solvers


def weights_of(recorded: Any, prefix: str = "w/") -> dict[tuple[str, int], np.ndarray]:
    """(layer, index) -> (iterations + 1, ...)."""
    keys = [key for key in recorded if key.startswith(prefix)]
    return {(key.split("/")[-2], int(key.split("/")[-1])): recorded[key] for key in keys}


class Follow:
    """Compares the weights with a recorded trajectory after every update."""

    def __init__(self, solver: netlib.Solver, trajectory: dict[tuple[str, int], np.ndarray], losses: Any) -> None:
        self.trajectory, self.losses, self.first = trajectory, losses, solver.iter
        self.worst = self.worst_loss = 0.0
        self.updates = 0
        solver.on_iteration = self

    def __call__(self, solver: netlib.Solver) -> None:
        self.updates += 1
        step = solver.iter - self.first
        loss = solver.net.loss()  # of the last batch: before the update
        self.worst_loss = max(self.worst_loss, abs(loss / float(self.losses[step - 1]) - 1))
        for (layer, index), steps in self.trajectory.items():
            self.worst = max(self.worst, distance(solver.net.params[layer][index].data, steps[step]))


@pytest.mark.parametrize(
    "case",
    ["adadelta", "adagrad", "adam", "lr_inv", "lr_multistep", "lr_poly", "lr_step", "nesterov", "rmsprop",
     "sgd_clip", "sgd_itersize3", "sgd_l1", "sgd_l2", "sgd_mom09", "sgd_mults", "snap_sgd_hdf5"],
)  # fmt: skip
def test_solver_follows_caffe_for_20_iterations(caffe_data: Path, monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    """Weights and loss after every update, and the learning rates."""
    monkeypatch.chdir(caffe_data / "solvers")
    recorded = np.load(f"traj_{case}.npz")
    solver = netlib.get_solver(f"solver_{case}.prototxt", snapshot=0, display=0)
    trajectory = weights_of(recorded)
    for (layer, index), steps in trajectory.items():
        solver.net.params[layer][index].data[...] = steps[0]
    follow = Follow(solver, trajectory, recorded["loss_last_subbatch"])
    solver.step(20)
    assert follow.updates == 20
    assert len(trajectory) == 6
    assert follow.worst <= 1e-5
    assert follow.worst_loss <= 1e-5
    rates = [learning_rate(solver.param, i) for i in range(20)]
    assert rates == pytest.approx(recorded["lr_printed"].tolist(), rel=1e-5)  # printed with six digits


def test_every_recorded_solver_case_is_tested(caffe_data: Path) -> None:
    """The list above has all of them."""
    index = json.loads((caffe_data / "solvers/index.json").read_text())
    tested = test_solver_follows_caffe_for_20_iterations.pytestmark[0].args[1]
    assert sorted(index) == tested


def test_weights_load_from_caffes_hdf5_snapshot(caffe_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The snapshot after 10 updates holds the weights of the trajectory."""
    monkeypatch.chdir(caffe_data / "solvers")
    net = netlib.Net("net.prototxt", "snap/snap_sgd_hdf5_iter_10.caffemodel.h5", netlib.TEST)
    for (layer, index), steps in weights_of(np.load("traj_snap_sgd_hdf5.npz")).items():
        assert np.array_equal(net.params[layer][index].data, steps[10])


def test_training_goes_on_from_caffes_solver_state(
    caffe_data: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Resumed from iteration 10, it follows Caffe's own resumed training to iteration 20 and its last snapshot."""
    monkeypatch.chdir(caffe_data / "solvers")
    recorded = np.load("traj_snap_sgd_hdf5.npz")
    solver = netlib.get_solver(
        "solver_snap_sgd_hdf5.prototxt", snapshot_prefix=str(tmp_path / "ours"), snapshot=10, display=0
    )
    solver.restore("snap/snap_sgd_hdf5_iter_10.solverstate.h5")
    assert solver.iter == 10
    follow = Follow(solver, weights_of(recorded, "resume/w/"), recorded["resume/loss_last_subbatch"])
    assert solver.solve()
    assert (follow.updates, solver.iter) == (10, 20)
    assert follow.worst <= 1e-5
    ours = snapshot.read_state(tmp_path / "ours_iter_20.solverstate.h5")
    theirs = snapshot.read_state("snap/snap_sgd_hdf5_iter_20.solverstate.h5")
    assert (ours.iter, ours.current_step) == (theirs.iter, theirs.current_step)
    assert [h.shape for h in ours.history] == [h.shape for h in theirs.history]


LOG_LINE = re.compile(r"(Iteration \d+|(?:Train|Test) net output #\d+|Snapshotting|Optimization Done)")
LOG_TEXT = re.compile(r"(?: \([-.\de]+ iter/s.*?\))|Snapshotting .*")


def words_and_numbers(lines: list[str]) -> list[tuple[str, list[float]]]:
    """What the lines of a training log say: text without numbers, and the numbers. Speed and paths do not count."""
    found = []
    for line in lines:
        if LOG_LINE.search(line):
            line = LOG_TEXT.sub("", line)
            numbers = re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", line)
            found.append((re.sub(r"-?\d[\d.e+-]*", "#", line).strip(), [float(n) for n in numbers]))
    return found


def test_the_log_of_a_training_is_caffes(
    caffe_data: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Line by line: display with average_loss, tests, learning rates, snapshots, the last test, the last line."""
    monkeypatch.chdir(caffe_data / "solvers")
    theirs = [line.split("] ", 1)[-1] for line in (caffe_data / "logs/a_avgloss.log").read_text().splitlines()]
    header = "\n".join(theirs[2 : theirs.index("Creating training net from net file: net.prototxt")])
    text = header.replace("init.caffemodel", "init.caffemodel.h5").replace('"snap/a"', f'"{tmp_path}/a"')
    (tmp_path / "solver.prototxt").write_text(text)
    caplog.set_level("INFO", "netlib")
    assert netlib.get_solver(tmp_path / "solver.prototxt").solve()
    want = words_and_numbers(theirs)[:-1]  # the tool's own line comes after the solver's
    got = words_and_numbers(caplog.messages)
    assert [words for words, _ in got] == [words for words, _ in want]
    assert len(got) > 30
    for (words, ours), (_, caffes) in zip(got, want):
        assert ours == pytest.approx(caffes, rel=2e-5), words


def test_the_papers_network_follows_caffe_for_50_iterations(
    caffe_data: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Every loss within 1e-5, every parameter's norm within 1e-4 (biases start as sums of cancelling gradients)."""
    text = re.sub(r"(?m)^[IWE]\d{8} .*\n?", "\n", (caffe_data / "logs/deepmodel_train.log").read_text())
    net = text[text.index('name: "DeepModel"') :]
    net = net[: net.index("\n\n")].replace('"train.txt"', f'"{tmp_path}/train.txt"')
    (tmp_path / "train.txt").write_text(f"{caffe_data}/deepmodel/train_0.h5\n")
    (tmp_path / "net.prototxt").write_text(net)
    (tmp_path / "solver.prototxt").write_text(
        f'net: "{tmp_path}/net.prototxt" base_lr: 0.003 momentum: 0.9 lr_policy: "fixed" max_iter: 50'
    )
    solver = netlib.get_solver(tmp_path / "solver.prototxt")
    solver.copy_weights(caffe_data / "deepmodel/init.caffemodel.h5")
    recorded = json.loads((caffe_data / "deepmodel/traj_nodrop.json").read_text())["iters"]
    losses, norms = [], []

    def compare(solver: netlib.Solver) -> None:
        want = recorded[solver.iter - 1]
        losses.append(abs(solver.net.loss() / want["DeepHandModelxyzloss"] - 1))
        for label, (norm, _) in want["param_l2norm_and_sum_after"].items():
            layer, index = label.split("/")
            norms.append(abs(float(np.linalg.norm(solver.net.params[layer][int(index)].data)) / norm - 1))

    solver.on_iteration = compare
    solver.step(50)
    assert len(losses) == 50
    assert max(losses) <= 1e-5
    assert len(norms) == 50 * 12
    assert max(norms) <= 1e-4
