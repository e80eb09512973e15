"""tools/train.py: Caffe's log, resume, signals, and one-line errors."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib
from netlib import engine
from netlib.files import locks
from netlib.snapshots import snapshot
from tests.support.running import run_tool
from tests.tools.conftest import ROOT
from tools.common import training

STAMP = r"I\d{4} \d\d:\d\d:\d\d\.\d{6} \d+ \w+\.py:\d+\] "


def mistake(argv, status=1):
    """Return the one line that an error prints."""
    done = run_tool("train", *argv, status=status)
    lines = [line for line in done.err.splitlines() if not re.match(STAMP + "|[a-z_]+:", line)]
    assert len(lines) == 1, lines
    return lines[0]


def weights(path):
    return {f"{name}/{i}": v for name, arrays in snapshot.read_weights(path).items() for i, v in arrays.items()}


def test_log_is_caffes(work):
    """The log has Caffe's lines for iterations, losses, outputs and learning rates."""
    done = run_tool("train", "solver.prototxt", "--log", "train.log")
    log = (work / "train.log").read_text()
    number = r"[-+\d.e]+"
    assert re.search(rf"{STAMP}Iteration 4 \({number} iter/s, {number}s/2 iters\), loss = {number}\n", log)
    assert re.search(rf"{STAMP}    Train net output #0: joint_loss = {number} \(\* 1 = {number} loss\)\n", log)
    assert re.search(rf"{STAMP}Iteration 3, Testing net \(#0\)\n", log)
    assert re.search(rf"{STAMP}    Test net output #1: limit_loss = {number} \(\* 1 = {number} loss\)\n", log)
    assert re.search(rf"{STAMP}Iteration 2, lr = 0\.003\n", log)
    assert re.search(rf"{STAMP}Optimization Done\.\n", log)
    assert "made from synthetic" in log
    assert log == done.err


def test_weights_of_zero_are_reported(tmp_path, monkeypatch):
    """A layer without a filler is reported if it learns and no file has its weights."""
    monkeypatch.chdir(tmp_path)
    layers = [
        f'layer {{ name: "{name}" type: "InnerProduct" bottom: "{bottom}" top: "{name}" {more} }}'
        for name, bottom, more in (
            ("zero", "x", "inner_product_param { num_output: 3 }"),
            ("fixed", "zero", "param { lr_mult: 0 } inner_product_param { num_output: 3 }"),
            ("filled", "fixed", 'inner_product_param { num_output: 2 weight_filler { type: "xavier" } }'),
        )
    ]
    data = 'layer { name: "x" type: "DummyData" top: "x" dummy_data_param { shape { dim: 4 dim: 2 } } }'
    loss = 'layer { name: "loss" type: "Reduction" bottom: "filled" top: "loss" loss_weight: 1 }'
    Path("net.prototxt").write_text(" ".join([data, *layers, loss]))
    Path("s.prototxt").write_text('net: "net.prototxt" base_lr: 1 lr_policy: "fixed" max_iter: 1 snapshot_prefix: "n"')

    def reported(*argv):
        return re.findall(r"layer '(\w+)': its weights start at 0", run_tool("train", "s.prototxt", *argv).err)

    assert reported() == ["zero"]
    net = netlib.Net("net.prototxt", netlib.TRAIN)
    net.params["zero"][0].data[...] = 1
    net.save("w.caffemodel")
    assert reported("--weights", "w.caffemodel") == []
    assert reported("--snapshot", "n_iter_1.solverstate") == []


def test_bvlcs_parsers_read_the_dates(work):
    """Caffe's parse_log.py and extract_seconds.py read month and day from columns 1 to 4, and start at 'Solving'."""
    run_tool("train", "solver.prototxt", "--log", "train.log")
    lines = (work / "train.log").read_text().splitlines()
    started = next(line for line in lines if "Solving" in line).split()
    month, day = int(started[0][1:3]), int(started[0][3:])
    assert 1 <= month <= 12 and 1 <= day <= 31
    clock, _, fraction = started[1].rpartition(".")
    assert [len(part) for part in (*clock.split(":"), fraction)] == [2, 2, 2, 6]


@pytest.mark.parametrize("name", ["plain", "fast"])
def test_engine(work, name):
    """--engine selects the engine, which the log names."""
    if name == "plain" or engine.has_fast():
        done = run_tool("train", "solver.prototxt", "--max-iter", "1", "--engine", name)
        assert f", engine {name}. BLAS:" in done.err
    assert "invalid choice: 'plane'" in run_tool("train", "solver.prototxt", "--engine", "plane", status=2).err


def test_a_resumed_training_adds_to_its_log(work):
    """A resumed run appends to its log; another run starts the file again."""
    run_tool("train", "solver.prototxt", "--max-iter", "3", "--log", "train.log")
    first = (work / "train.log").read_text()
    run_tool("train", "solver.prototxt", "--snapshot", "snapshots/net_iter_3.solverstate", "--log", "train.log")
    both = (work / "train.log").read_text()
    assert both.startswith(first) and both.count("Optimization Done.") == 2
    run_tool("train", "solver.prototxt", "--max-iter", "1", "--log", "train.log")
    assert (work / "train.log").read_text().count("Optimization Done.") == 1


def test_resume_is_exact(work):
    """Six iterations equal three, a resume, and three more."""
    run_tool("train", "solver.prototxt")
    whole = weights("snapshots/net_iter_6.caffemodel")
    run_tool("train", "solver.prototxt", "--snapshot", "snapshots/net_iter_3.solverstate")
    resumed = weights("snapshots/net_iter_6.caffemodel")
    assert all(np.array_equal(whole[name], resumed[name]) for name in whole)


def test_seed_and_threads(work):
    """The result depends on the seed, but not on the number of threads."""
    results = []
    for extra in (["--seed", "5"], ["--seed", "5", "--threads", "1"], ["--seed", "6"]):
        run_tool("train", "solver.prototxt", "--max-iter", "2", *extra)
        results.append(weights("snapshots/net_iter_2.caffemodel")["DoF/0"])
    assert np.array_equal(results[0], results[1])
    assert not np.array_equal(results[0], results[2])


def test_threads_are_those_of_the_engine(work, other_engine):
    """--threads applies to the engine of --engine, even if NETLIB_ENGINE selects another one."""
    done = run_tool("train", "solver.prototxt", "--max-iter", "1", "--engine", "fast", "--threads", "3")
    assert "Use CPU, 3 threads, engine fast. " in done.err


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_snapshots_and_stops(work, number, status):
    """Ctrl-C and SIGTERM finish the iteration, write a snapshot, and determine the exit status."""
    command = [sys.executable, str(ROOT / "tools" / "train.py"), "solver.prototxt", "--max-iter", "100000"]
    lines = []
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        for line in process.stderr:
            lines.append(line)
            if "Iteration 4 " in line:
                process.send_signal(number)
    assert process.returncode == status
    assert "Optimization stopped early." in lines[-1]
    last = int(re.search(r"net_iter_(\d+)\.solverstate", "".join(lines[-4:])).group(1))
    assert (work / f"snapshots/net_iter_{last}.caffemodel").exists()


def test_hangup_snapshots_and_goes_on(work, monkeypatch):
    """SIGHUP writes a snapshot without stopping."""
    timer = threading.Timer(0, os.kill, [os.getpid(), signal.SIGHUP])
    original = training.requests_by_signal

    @contextlib.contextmanager
    def catch(solver, *effects):
        with original(solver, *effects) as stopped:
            timer.start()
            timer.join()
            yield stopped

    monkeypatch.setattr(training, "requests_by_signal", catch)
    run_tool("train", "solver.prototxt", "--max-iter", "2")
    assert (work / "snapshots/net_iter_1.solverstate").exists()


@pytest.fixture(autouse=True)
def kept_signals():
    """Check that training restores the signal handlers."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(n) for n in numbers]
    yield
    assert [signal.getsignal(n) for n in numbers] == before


def test_missing_data_says_how_to_make_it(tmp_path, monkeypatch):
    """Without data/nyu, one line names the two commands that create it."""
    shutil.copytree(ROOT / "prototxt", tmp_path / "prototxt")
    monkeypatch.chdir(tmp_path)
    line = mistake(["prototxt/nyu_solver.prototxt"])
    assert line.startswith("data/nyu/train.txt: cannot read the list of HDF5 files: No such file or directory")
    assert "tools/make_synthetic.py" in line and "tools/prepare_nyu.py NYU_ROOT" in line


def test_mistakes(work):
    """Each error is one line with its position."""
    run_tool("train", "solver.prototxt", "--max-iter", "3")
    state, model = "snapshots/net_iter_3.solverstate", "snapshots/net_iter_3.caffemodel"
    assert mistake(["nothing.prototxt"]) == "nothing.prototxt: cannot read the prototxt: No such file or directory"
    assert "this is a weights file" in mistake(["solver.prototxt", "--snapshot", model])
    assert "this is a solver state" in mistake(["solver.prototxt", "--weights", state])
    (work / "bad.prototxt").write_text('net: "net.prototxt"\nbase_lr: 0.1 lr_polizy: "fixed"')
    assert mistake(["bad.prototxt"]).startswith("bad.prototxt:2:14: error: unknown field 'lr_polizy' (did you mean")
    (work / "cut.state").write_bytes((work / state).read_bytes()[:3000])
    assert "cut.state: byte 0: truncated" in mistake(["solver.prototxt", "--snapshot", "cut.state"])


def test_usage():
    """Wrong usage gives argparse's message and status 2."""
    for argv in ([], ["s", "--max-iter", "0"], ["s", "--snapshot", "a", "--weights", "b"]):
        run_tool("train", *argv, status=2)


def test_nan_in_the_data_stops(work, small_data):
    """A frame with NaN stops training with the name of the blob, and no snapshot is written."""
    with h5py.File(small_data / "train_000.h5") as file:
        arrays = {name: file[name][...] for name in ("depth", "joint")}
    arrays["depth"][5, 0, 3, 3] = np.nan
    with h5py.File("nan.h5", "w") as file:
        for name, array in arrays.items():
            file[name] = array
    (work / "nan.txt").write_text("nan.h5\n")
    net = (work / "net.prototxt").read_text().replace(f"{small_data}/train.txt", "nan.txt")
    (work / "net.prototxt").write_text(net.replace("shuffle: true", ""))
    line = mistake(["solver.prototxt"])
    assert "iteration 0: the loss is nan" in line and "top blob 'depth' of layer 'data'" in line
    assert not list(work.glob("snapshots/*iter*"))


def test_a_full_disk_ends_the_log_not_the_training(work, monkeypatch):
    """If the disk of the log is full, one line reports it and training continues."""
    errors = run_tool("train", "solver.prototxt", "--max-iter", "1", "--log", "/dev/full").err
    assert errors.count("/dev/full: cannot continue the log: No space left on device") == 1
    assert (work / "snapshots/net_iter_1.solverstate").exists()


LOGS = ["solver.prototxt", "net.prototxt", "data/train.txt", "data/train_000.h5", "mine.caffemodel", "link.log"]


@pytest.mark.parametrize("log", LOGS)
def test_a_log_that_is_read(work, small_data, log):
    """A log that is an input of the training run is rejected on one line and not changed."""
    shutil.copytree(small_data, "data")
    Path("data/train.txt").write_text("data/train_000.h5\n")
    net = Path("net.prototxt").read_text().replace(f"{small_data}/train.txt", "data/train.txt")
    Path("net.prototxt").write_text(net)
    netlib.Net("net.prototxt", netlib.TRAIN).save("mine.caffemodel")
    Path("link.log").symlink_to("solver.prototxt")
    before = Path(log).read_bytes()
    argv = ["solver.prototxt", "--weights", "mine.caffemodel", "--log", log]
    assert mistake(argv) == f"{log}: is read in this run; expected another output"
    assert Path(log).read_bytes() == before


def test_a_log_that_is_the_state(work):
    """A log that is the solver state is rejected and not changed."""
    run_tool("train", "solver.prototxt", "--max-iter", "3")
    state = work / "snapshots/net_iter_3.solverstate"
    before = state.read_bytes()
    argv = ["solver.prototxt", "--snapshot", str(state), "--log", str(state)]
    assert mistake(argv) == f"{state}: is read in this run; expected another output"
    assert state.read_bytes() == before


@pytest.mark.parametrize("solver", ["typo.prototxt", "bad.prototxt"])
def test_a_start_that_fails_leaves_an_older_log_alone(work, solver):
    """A run that fails to start neither changes an old log nor creates a new one."""
    (work / "bad.prototxt").write_text('net: "net.prototxt"\nbase_lr: 0.1 lr_polizy: "fixed"')
    (work / "old.log").write_text("old")
    for log in ("old.log", "new/new.log"):
        mistake([solver, "--log", log])
    assert (work / "old.log").read_text() == "old" and not (work / "new").exists()


def test_a_training_that_is_rejected_leaves_an_older_log_alone(work):
    """A second training of the same snapshots, or one that cannot write them, does not begin a log."""
    (work / "old.log").write_text("old")
    (work / "snapshots").mkdir()
    first = locks.Lock(work / "snapshots" / ".net.netlib.lock")
    assert "another training is writing" in mistake(["solver.prototxt", "--log", "old.log"])
    first.release()
    (work / "snapshots").rmdir()
    (work / "snapshots").touch()
    done = run_tool("train", "solver.prototxt", "--log", "old.log", status=1)
    assert "cannot write snapshots there" in done.err.splitlines()[-1]
    assert (work / "old.log").read_text() == "old"


def test_a_log_with_another_name(work):
    """A hard link is rejected, because the file has another name under which it would change."""
    (work / "precious").write_text("mine")
    os.link("precious", "train.log")
    assert "a hard link" in mistake(["solver.prototxt", "--log", "train.log"])
    assert (work / "precious").read_text() == "mine"


def test_a_pipe_without_a_reader(work):
    """A log that is a pipe which no process reads is an error, not a wait."""
    os.mkfifo("pipe.log")
    assert mistake(["solver.prototxt", "--log", "pipe.log"]).startswith("pipe.log: cannot write the log: ")


def test_a_log_that_another_process_writes(work):
    """A log that another process writes is not changed."""
    with open("train.log", "a+") as other:
        other.write("theirs")
        other.flush()
        assert locks.take(other.fileno())
        assert "another process is writing this log" in mistake(["solver.prototxt", "--log", "train.log"])
    assert (work / "train.log").read_text() == "theirs"


def test_a_log_in_a_place_where_none_can_be(work):
    """A log that cannot be created gives a one-line error."""
    line = mistake(["solver.prototxt", "--log", "net.prototxt/a.log"])
    assert line.startswith("net.prototxt/a.log: cannot write the log: ")
    assert mistake(["solver.prototxt", "--log", "."]) == ".: cannot write the log: Is a directory"
