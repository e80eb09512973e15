"""Ranks over MPI, and training on two of them: equal to one rank, exact, and ended if a rank ends.

rank_programs.py runs the checks in real processes.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import netlib
from tests.netlib.distributed.small_net import ADAM, NET, SOLVER, write_files
from tests.support import ranks_started
from tests.support.hdf5_files import write_hdf5
from tests.support.ranks_started import PROGRAMS, ROOT, needs_mpi

pytestmark = needs_mpi

PAPER = """
net: "paper.prototxt" base_lr: 0.003 momentum: 0.9 lr_policy: "fixed" max_iter: 8 average_loss: 2 random_seed: 1
test_iter: 1 test_interval: 100 test_initialization: false snapshot_after_train: false
"""


@pytest.fixture(autouse=True)
def small(tmp_path, monkeypatch):
    """Change to a folder with a small net on three files of rows, and solver.prototxt for a
    long training run.
    """
    monkeypatch.chdir(tmp_path)
    write_files()


def run(*programs):
    done = ranks_started.run(2, PROGRAMS, *programs)
    assert done.returncode == 0, done.stderr


def test_four_ranks():
    """Sums are exact in the order of the ranks, and all ranks agree on requests and errors."""
    programs = ["sums", "agreement", "errors"]
    done = ranks_started.run(4, PROGRAMS, *programs)
    assert done.returncode == 0, done.stderr
    assert sorted(done.stdout.split("\n")[:-1]) == sorted(
        f"rank {r} {name}" for name in programs for r in range(4)
    )


def test_two_ranks_are_one_with_twice_the_batch(rng):
    """The losses of 8 iterations agree to 1e-5 for the paper's network without dropout, and for
    Adam with clipped gradients and iter_size.
    """
    write_hdf5(
        "frames.h5",
        depth=rng.uniform(-1, 1, (40, 1, 128, 128)),
        joint=rng.uniform(-0.5, 0.5, (40, 93)),
    )
    Path("frames.txt").write_text("frames.h5\n")
    text = (ROOT / "prototxt" / "nyu_train_test.prototxt").read_text()
    text = re.sub(r"layer \{ name: .Dropout.*\n", "", text).replace(
        "num_output: 1024", "num_output: 64"
    )
    text = re.sub(r"data/nyu/\w+.txt", "frames.txt", text).replace(
        "batch_size: 250", "batch_size: 10"
    )
    Path("paper.prototxt").write_text(
        text.replace('"hand/', f'"{ROOT}/prototxt/hand/').replace("size: 512", "size: 8")
    )
    Path("losses_paper.prototxt").write_text(PAPER)
    Path("losses_adam.prototxt").write_text(ADAM)
    run("losses")
    for net in ("paper.prototxt", "small.prototxt"):
        Path(net).write_text(Path(net).read_text().replace("batch_size: 8", "batch_size: 16"))
    for name in ("losses_paper", "losses_adam"):
        alone = []
        one = netlib.get_solver(f"{name}.prototxt")
        for _ in range(8):
            one.step(1)
            alone.append(one.smoothed[-1])
        np.testing.assert_allclose(json.loads(Path(f"{name}.json").read_text()), alone, rtol=1e-5)
        assert len(set(alone)) == 8


def test_exact(caplog):
    """Training and resuming are reproducible bit for bit with dropout, shuffling and running means,
    whenever gradients are averaged; two solvers can alternate; a changed bit on one rank is
    detected; another number of ranks resumes with a note.
    """
    more = """layer { name: "norm" type: "BatchNorm" bottom: "h" top: "h" }
layer { name: "drop" type: "Dropout" bottom: "h" top: "h" }
layer { name: "relu\""""
    Path("exact_net.prototxt").write_text(
        NET.replace('layer { name: "relu"', more).replace(
            "batch_size: 8", "batch_size: 4 shuffle: true"
        )
    )
    solver = SOLVER.replace("small.prototxt", "exact_net.prototxt").replace(
        "snapshots/small", "snapshots/exact"
    )
    Path("exact.prototxt").write_text(
        solver.replace("1000000", "6").replace("snapshot: 20", "snapshot: 3")
    )
    Path("small_solver.prototxt").write_text(ADAM)
    run("resume", "two_solvers", "checksum")
    with caplog.at_level("INFO", "netlib"):
        netlib.get_solver("exact.prototxt").restore("snapshots/exact_iter_3.solverstate")
    assert [message for message in caplog.messages if "Changed: " in message] == [
        "Changed: number of ranks was 2, is now 1"
    ]


@pytest.mark.parametrize("how", ["killed", "failed"])
def test_a_rank_that_ends_on_its_own(how):
    """A rank that is killed, or raises an error of Python, ends all ranks; nothing hangs."""
    done = ranks_started.run(2, PROGRAMS, how)
    assert done.returncode != 0
    assert ("ZeroDivisionError" in done.stderr) == (how == "failed")
