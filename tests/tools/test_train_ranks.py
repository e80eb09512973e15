"""tools/train.py on several ranks, with real ``mpiexec``: equal to one rank, exact, and ended on all ranks at once."""

import json
import os
import re
import shutil
import signal
from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib
from tests.support import ranks_started
from tests.support.hdf5_files import write_hdf5
from tests.support.ranks_started import CAFFE, PROGRAMS, TRAIN, needs_mpi, ours
from tools.common import training

pytestmark = needs_mpi

NET = """
layer { name: "data" type: "HDF5Data" top: "x" top: "y" include { phase: TRAIN }
        hdf5_data_param { source: "list.txt" batch_size: 8 } }
layer { name: "data" type: "HDF5Data" top: "x" top: "y" include { phase: TEST }
        hdf5_data_param { source: "list.txt" batch_size: 9 } }
layer { name: "fc1" type: "InnerProduct" bottom: "x" top: "h"
        inner_product_param { num_output: 20 weight_filler { type: "xavier" } } }
layer { name: "relu" type: "ReLU" bottom: "h" top: "h" }
layer { name: "fc2" type: "InnerProduct" bottom: "h" top: "p"
        inner_product_param { num_output: 2 weight_filler { type: "xavier" } } }
layer { name: "loss" type: "EuclideanLoss" bottom: "p" bottom: "y" top: "loss" }
"""
SOLVER = """
net: "small.prototxt" type: "SGD" base_lr: 0.001 momentum: 0.9 lr_policy: "fixed" max_iter: 1000000 display: 20
test_iter: 3 test_interval: 40 snapshot: 20 snapshot_prefix: "snapshots/small" random_seed: 3
"""
ADAM = """
net: "small.prototxt" type: "Adam" base_lr: 0.01 momentum: 0.9 momentum2: 0.999 lr_policy: "fixed" clip_gradients: 5
iter_size: 2 max_iter: 100 random_seed: 3
"""


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A folder with a small net on three files of rows, and solver.prototxt for a long training run."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    for i, rows in enumerate((31, 9, 20)):
        x = rng.standard_normal((rows, 6)).astype(np.float32)
        write_hdf5(f"d{i}.h5", x=x, y=x[:, :2] - x[:, 2:4])
    Path("list.txt").write_text("d0.h5\nd1.h5\nd2.h5\n")
    Path("small.prototxt").write_text(NET)
    Path("solver.prototxt").write_text(SOLVER)
    return tmp_path


def for_rank(number):
    """Copy the files to the folder that this rank runs in."""
    folder = Path(f"rank.{number}")
    folder.mkdir()
    for path in Path().glob("*.*"):
        if path.is_file():
            shutil.copy(path, folder)
    return folder


def ends(process, status):
    """Wait for the process to end with this status; return its remaining output."""
    rest = process.communicate(timeout=ranks_started.TIMEOUT_S)[0]
    assert process.returncode == status, rest
    return rest


def whole_snapshot():
    """Return the iteration of the newest solver state, after restoring it."""
    solver = netlib.get_solver("solver.prototxt")
    states = sorted(Path("snapshots").glob("*.solverstate"), key=lambda path: int(path.stem.split("_")[-1]))
    solver.restore(states[-1])
    return solver.iter


def test_two_ranks_are_one_with_twice_the_batch(small, work, small_data):
    """The losses of 8 iterations agree to 1e-5 for the paper's network without dropout, and for Adam with clipped
    gradients and iter_size.
    """
    text = re.sub(r"layer \{ name: .Dropout.*\n", "", Path("net.prototxt").read_text())
    Path("net.prototxt").write_text(text.replace("batch_size: 16", "batch_size: 8"))
    solver = Path("solver.prototxt").read_text()
    Path("losses_paper.prototxt").write_text(
        re.sub(r"test_iter.*|snapshot: 3.*", "", solver) + "snapshot_after_train: false"
    )
    Path("losses_adam.prototxt").write_text(ADAM)
    done = ranks_started.run(2, PROGRAMS, "losses")
    assert done.returncode == 0, done.stderr
    for net in ("net.prototxt", "small.prototxt"):
        Path(net).write_text(Path(net).read_text().replace("batch_size: 8", "batch_size: 16"))
    for name in ("losses_paper", "losses_adam"):
        alone = []
        one = netlib.get_solver(f"{name}.prototxt")
        for _ in range(8):
            one.step(1)
            alone.append(one.smoothed[-1])
        np.testing.assert_allclose(json.loads(Path(f"{name}.json").read_text()), alone, rtol=1e-5)
        assert len(set(alone)) == 8


def test_caffes_command(small):
    """tools/caffe.py train equals tools/train.py on two ranks, and the log is written once."""
    Path("short.prototxt").write_text(SOLVER.replace("1000000", "20"))
    weights = []
    for words in ([TRAIN, "short.prototxt"], [CAFFE, "train", "-solver", "short.prototxt"]):
        done = ranks_started.run(2, *words)
        assert done.returncode == 0, done.stderr
        assert done.stderr.count("2 ranks × 8 = 16 per step") == done.stderr.count("lr = 0.001") == 1, done.stderr
        weights.append(Path("snapshots/small_iter_20.caffemodel").read_bytes())
    assert weights[0] == weights[1]


def test_exact(small, work):
    """Training and resuming are reproducible bit for bit with dropout, augmentation, shuffling and running means,
    whenever gradients are averaged; two solvers can alternate; a changed bit on one rank is detected; another number of
    ranks resumes with a note.
    """
    text = Path("net.prototxt").read_text().replace("batch_size: 16", "batch_size: 4")
    augment = (
        'layer { name: "augment" type: "HandAugment" bottom: "depth" bottom: "joint" top: "depth" top: "joint" }\n'
    )
    norm = 'layer { name: "norm" type: "BatchNorm" bottom: "FC1" top: "FC1" }\n'
    first, second = text.index('layer {\n  name: "convL1"'), text.index('layer { name: "ReLUFC1"')
    Path("net.prototxt").write_text(text[:first] + augment + text[first:second] + norm + text[second:])
    Path("exact.prototxt").write_text(Path("solver.prototxt").read_text().replace("snapshots/net", "snapshots/exact"))
    Path("small_solver.prototxt").write_text(ADAM)
    done = ranks_started.run(2, PROGRAMS, "resume", "two_solvers", "checksum")
    assert done.returncode == 0, done.stderr
    assert (
        training.train("exact.prototxt", snapshot="snapshots/exact_iter_3.solverstate", max_iter=4, log_file="log") == 0
    )
    assert [line.split("] ")[1] for line in Path("log").read_text().splitlines() if "Changed: " in line] == [
        "Changed: number of ranks was 2, is now 1"
    ]


def test_wrong_usage_is_said_once(work):
    """The usage error is printed once, and mpiexec returns status 2, with and without ``-m mpi4py``."""
    for by in (("-m", "mpi4py"), ()):
        done = ranks_started.run(2, TRAIN, "--patience", "0", "solver", by=by)
        assert done.returncode == 2
        assert ours(done.stderr) == [
            "usage: train.py [-h] [--no-python-layers] [--snapshot STATE] [--weights FILE]",
            "train.py: error: argument --patience: expected a number greater than 0 and at most 1e+06, found '0'",
        ]


def test_a_signal_to_mpiexec(small):
    """SIGUSR1 writes a snapshot; SIGTERM writes one and stops all ranks; only rank 0 logs; the resume is exact."""
    with ranks_started.started(2, TRAIN, "solver.prototxt", "--log", "log") as process:
        lines = ranks_started.lines_until(process, "Iteration 20 (")
        process.send_signal(signal.SIGUSR1)
        lines += ranks_started.lines_until(process, "Snapshotting solver state to binary proto")
        process.send_signal(signal.SIGTERM)
        lines += ends(process, 128 + signal.SIGTERM).splitlines()
    assert sum("2 ranks × 8 = 16 per step; base_lr is not scaled" in line for line in lines) == 1
    assert sum("Optimization stopped early" in line for line in lines) == 1
    stopped = whole_snapshot()
    assert stopped == max(int(i) for i in re.findall(r"state to .*_iter_(\d+)", "\n".join(lines)))
    written = re.findall(r"state to .*_iter_(\d+)", "\n".join(lines))
    assert written.count(str(stopped)) <= 2  # twice if SIGTERM arrives before the iteration after SIGUSR1's snapshot
    said = [line for line in Path("log").read_text().splitlines() if re.match(r"[IWE]\d{4} ", line)]
    assert said == [line for line in lines if re.match(r"[IWE]\d{4} ", line)]
    again = ranks_started.run(2, TRAIN, "solver.prototxt", "--snapshot", f"snapshots/small_iter_{stopped}.solverstate",
                              "--max-iter", stopped + 1)
    assert again.returncode == 0 and "averaged loss; the resume is exact" in again.stderr


def test_a_rank_that_hangs(small):
    """A hanging rank ends all ranks and is named; the last snapshot is complete."""
    done = ranks_started.run(2, PROGRAMS, "stopped")
    assert done.returncode != 0  # whether mpiexec reports the rank that gave up or the one it killed is a race
    (line,) = ours(done.stderr)
    assert re.fullmatch(r"no response from rank 1 for \d+ s; all ranks end, the last snapshot is untouched", line)
    assert whole_snapshot() == 40


def test_one_process_of_a_training_is_stopped(small):
    """SIGTERM to one rank ends all after a snapshot, which is complete."""
    with ranks_started.started(2, TRAIN, "solver.prototxt", "--patience", "600") as process:
        lines = ranks_started.lines_until(process, "Snapshotting to binary proto file snapshots/small_iter_40")
        os.kill(int(Path("pid.1").read_text()), signal.SIGTERM)
        rest = ends(process, 128 + signal.SIGTERM)
    assert ours(rest) == [], lines
    assert whole_snapshot() >= 40


def nan(folder):
    """Write NaN into rows that are read after some steps."""
    with h5py.File(folder / "d2.h5", "a") as file:
        file["y"][:19] = np.nan


def other_net(folder):
    (folder / "small.prototxt").write_text(NET.replace("num_output: 20", "num_output: 21"))


def no_file(folder):
    (folder / "d1.h5").unlink()


def test_what_one_rank_finds_ends_all(small):
    """NaN, another prototxt and a missing file give one line that names the rank; nothing is written."""
    for break_it, said in (
        (nan, r"rank 1: iteration \d+: the loss is nan; .* top blob 'y' of layer 'data'.*"),
        (other_net, r"rank 1 has another net prototxt than rank 0: .*; expected the same on all"),
        (no_file, r"rank 1: list.txt: names 'd1.h5', which does not exist; .*"),
    ):
        shutil.rmtree("snapshots", ignore_errors=True)
        break_it(for_rank(1))
        done = ranks_started.run(2, TRAIN, "solver.prototxt", "--max-iter", "19")
        shutil.rmtree("rank.1")
        assert done.returncode == 1
        (line,) = ours(done.stderr)
        assert re.fullmatch(said, line), line
        assert not list(Path().rglob("*.solverstate"))
