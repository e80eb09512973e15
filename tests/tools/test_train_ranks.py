"""tools/train.py on several ranks, with real ``mpiexec``: signals, and errors that end all
ranks at once.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib
from netlib.errors import NetlibError
from tests.netlib.distributed.small_net import NET, SOLVER, whole_snapshot, write_files
from tests.support import ranks_started
from tests.support.ranks_started import CAFFE, TRAIN, needs_mpi, ours
from tools.common import ranks

pytestmark = needs_mpi


@pytest.fixture
def small(here):
    """Change to a folder with a small net on three files of rows, and solver.prototxt for a
    long training run.
    """
    write_files()


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


def test_caffes_command(small):
    """tools/caffe.py train and ``python -m netlib train`` equal tools/train.py on two ranks, and
    the log is written once.
    """
    Path("short.prototxt").write_text(SOLVER.replace("1000000", "20"))
    weights = []
    for words in (
        [TRAIN, "short.prototxt"],
        [CAFFE, "train", "-solver", "short.prototxt"],
        ["-m", "netlib", "train", "short.prototxt"],
    ):
        done = ranks_started.run(2, *words)
        assert done.returncode == 0, done.stderr
        assert (
            done.stderr.count("2 ranks × 8 = 16 per step") == done.stderr.count("lr = 0.001") == 1
        ), done.stderr
        weights.append(Path("snapshots/small_iter_20.caffemodel").read_bytes())
    assert weights[0] == weights[1] == weights[2]


def test_wrong_usage_is_reported_once(small):
    """The status of mpiexec is 2, with and without ``-m mpi4py``."""
    for by in (("-m", "mpi4py"), ()):
        done = ranks_started.run(2, TRAIN, "--max-iter", "x", "solver", by=by)
        assert done.returncode == 2
        assert ours(done.stderr) == [
            "usage: train.py [-h] [--no-python-layers] [--snapshot STATE | --weights FILE]",
            "train.py: error: argument --max-iter: expected an integer of at least 1, found 'x'",
        ]


def test_a_signal_to_mpiexec(small):
    """SIGUSR1 writes a snapshot; SIGTERM writes one and stops all ranks; only rank 0 logs; the
    resume is exact.
    """
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
    # twice if SIGTERM arrives before the iteration after SIGUSR1's snapshot
    assert written.count(str(stopped)) <= 2
    said = [line for line in Path("log").read_text().splitlines() if re.match(r"[IWE]\d{4} ", line)]
    assert said == [line for line in lines if re.match(r"[IWE]\d{4} ", line)]
    again = ranks_started.run(
        2,
        TRAIN,
        "solver.prototxt",
        "--snapshot",
        f"snapshots/small_iter_{stopped}.solverstate",
        "--max-iter",
        stopped + 1,
    )
    assert again.returncode == 0
    assert "averaged loss; the resume is exact" in again.stderr


def test_one_process_of_a_training_is_stopped(small):
    """SIGTERM to one rank ends all after a snapshot, which is complete."""
    with ranks_started.started(2, TRAIN, "solver.prototxt") as process:
        lines = ranks_started.lines_until(
            process, "Snapshotting to binary proto file snapshots/small_iter_40"
        )
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


def test_an_error_on_one_rank_ends_all(small):
    """NaN, another prototxt and a missing file give one line that names the rank;
    nothing is written.
    """
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


@pytest.mark.parametrize("words", [[TRAIN], ["-m", "netlib", "train"]])
def test_ranks_that_the_command_starts_divide_the_batch(words, small):
    """Two processes with half the batch each train what one process does, to rounding."""
    Path("short.prototxt").write_text(SOLVER.replace("1000000", "20"))
    weights = []
    for options in ([], ["--ranks", "2"]):
        done = subprocess.run(
            [sys.executable, *map(str, words), "short.prototxt", *options],
            capture_output=True,
            text=True,
            timeout=ranks_started.TIMEOUT_S,
        )
        assert done.returncode == 0, done.stderr
        assert ("2 ranks × 4 = 8 per step" in done.stderr) == bool(options), done.stderr
        weights.append(netlib.Net("small.prototxt", "snapshots/small_iter_20.caffemodel", 0))
    for one, two in zip(*(net.learnable for net in weights)):
        np.testing.assert_allclose(two.blob.data, one.blob.data, rtol=1e-4, atol=1e-6)


def test_ranks_within_other_ranks_are_wrong_usage(small):
    done = ranks_started.run(2, TRAIN, "solver.prototxt", "--ranks", "3")
    assert "--ranks 3, but 2 processes were started" in done.stderr


def test_ranks_without_mpi_are_one_line(small, monkeypatch, capsys):
    monkeypatch.setattr(ranks, "find_spec", lambda name: None)
    with pytest.raises(NetlibError, match="need mpi4py and mpiexec"):
        ranks.start(2)
