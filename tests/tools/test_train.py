"""tools/train.py: Caffe's log, resume, signals, and one-line errors."""

import logging
import re
import shlex
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.distributed.ranks import ALONE
from netlib.files import locks
from netlib.snapshots import snapshot
from tests.support.running import run_tool
from tools.common import training_log

READ = "is read in this run; expected another output"
STAMP = r"I\d{4} \d\d:\d\d:\d\d\.\d{6} \d+ \w+\.py:\d+\] "


def train(options="", status=0):
    return run_tool(f"train solver.prototxt {options}", status=status)


def mistake(options=""):
    lines = [
        line
        for line in train(options, status=1).err.splitlines()
        if not re.match(STAMP + "|[a-z_]+:", line)
    ]
    assert len(lines) == 1, lines
    return lines[0]


def weights(path):
    layers = snapshot.read_weights(path).items()
    return {f"{name}/{i}": values for name, arrays in layers for i, values in arrays.items()}


def test_log(work):
    """The log has the lines of standard error, with glog's stamps; tests/caffe compares
    them with Caffe's.
    """
    done = train("--log train.log")
    log = (work / "train.log").read_text()
    assert log == done.err
    assert "made from synthetic" in log
    assert re.search(STAMP + r"Network initialization done: \d+ parameters, seed 1\n", log)
    for line in (
        r"Iteration 4 \([-+\d.e]+ iter/s, ",
        r"Iteration 3, Testing net \(#0\)\n",
        r"Optimization Done\.\n",
    ):
        assert re.search(STAMP + line, log)


ZERO = """
layer { name: "x" type: "DummyData" top: "x" dummy_data_param { shape { dim: 4 dim: 2 } } }
layer { name: "zero" type: "InnerProduct" bottom: "x" top: "zero" inner_product_param { num_output: 3 } }
layer { name: "fixed" type: "InnerProduct" bottom: "zero" top: "fixed" param { lr_mult: 0 }
        inner_product_param { num_output: 3 } }
layer { name: "filled" type: "InnerProduct" bottom: "fixed" top: "filled"
        inner_product_param { num_output: 2 weight_filler { type: "xavier" } } }
layer { name: "loss" type: "Reduction" bottom: "filled" top: "loss" loss_weight: 1 }
"""


def test_weights_of_zero_are_reported(here):
    """A layer without a filler is reported if it learns and no file has its weights."""
    Path("net.prototxt").write_text(ZERO)
    Path("solver.prototxt").write_text(
        'net: "net.prototxt" base_lr: 1 lr_policy: "fixed" max_iter: 1'
    )
    net = netlib.Net("net.prototxt", netlib.TRAIN)
    net.params["zero"][0].data[...] = 1
    net.save("w.caffemodel")
    for options, reported in (
        ("", ["zero"]),
        ("--weights w.caffemodel", []),
        ("--snapshot solver_iter_1.solverstate", []),
    ):
        assert re.findall(r"layer '(\w+)': its weights start at 0", train(options).err) == reported


def test_threads_are_those_of_the_engine(work, other_engine):
    """The log names engine and threads; --threads applies to the engine of --engine, not to that of
    NETLIB_ENGINE.
    """
    assert "Use CPU, 1 thread, engine plain. BLAS:" in train("--max-iter 1").err
    done = train("--max-iter 1 --engine fast --threads 3")
    assert "Use CPU, 3 threads, engine fast. " in done.err


def test_resume(work):
    """Three iterations, a resume and three more equal six, and add to the log; another run starts
    the log again.
    """
    train("--max-iter 3 --log train.log")
    first = (work / "train.log").read_text()
    train("--snapshot snapshots/net_iter_3.solverstate --log train.log")
    both = (work / "train.log").read_text()
    assert both.startswith(first)
    assert both.count("Optimization Done.") == 2
    resumed = weights("snapshots/net_iter_6.caffemodel")
    train("--log train.log")
    assert (work / "train.log").read_text().count("Optimization Done.") == 1
    whole = weights("snapshots/net_iter_6.caffemodel")
    assert all(np.array_equal(whole[name], resumed[name]) for name in whole)


def test_seed_and_threads(work):
    """The result depends on the seed, but not on the number of threads."""
    results = []
    for options in ("--seed 5", "--seed 5 --threads 1", "--seed 6"):
        train(f"--max-iter 2 {options}")
        results.append(weights("snapshots/net_iter_2.caffemodel")["DoF/0"])
    assert np.array_equal(results[0], results[1])
    assert not np.array_equal(results[0], results[2])


@pytest.mark.parametrize(
    ("number", "status", "last"),
    [(signal.SIGINT, 130, 1), (signal.SIGTERM, 143, 1), (signal.SIGHUP, 0, 2)],
)
def test_signals(work, signal_at_start, number, status, last):
    """Ctrl-C and SIGTERM finish the iteration, write a snapshot, and determine the exit status;
    SIGHUP goes on.

    The signal handlers are restored. The last line is the command that continues.
    """
    handlers = [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with open("solver.prototxt", "a") as file:
        file.write("test_initialization: false")
    signal_at_start(number)
    lines = train("--max-iter 2", status=status).err.splitlines()
    assert handlers == [
        signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    ]
    assert ("Optimization stopped early." in lines[-2]) == (last == 1)
    for i in {1, last}:
        assert (work / f"snapshots/net_iter_{i}.solverstate").exists()
    if last == 1:
        start, _, command = lines[-1].partition(" python tools/train.py ")
        assert start == "continue:"
        run_tool("train", *shlex.split(command))
        assert (work / "snapshots/net_iter_2.solverstate").exists()


def test_mistakes(work):
    train("--max-iter 3")
    state, model = "snapshots/net_iter_3.solverstate", "snapshots/net_iter_3.caffemodel"
    assert "this is a weights file" in mistake(f"--snapshot {model}")
    assert "this is a solver state" in mistake(f"--weights {state}")
    (work / "cut.state").write_bytes((work / state).read_bytes()[:3000])
    assert "cut.state: byte 0: truncated" in mistake("--snapshot cut.state")
    assert mistake(f"--snapshot {state} --log {state}") == f"{state}: {READ}"
    assert (work / state).read_bytes()[:3000] == (work / "cut.state").read_bytes()
    Path("solver.prototxt").write_text('net: "net.prototxt"\nbase_lr: 0.1 lr_polizy: "fixed"')
    assert mistake().startswith(
        "solver.prototxt:2:14: error: unknown field 'lr_polizy' (did you mean"
    )
    Path("solver.prototxt").unlink()
    assert mistake() == "solver.prototxt: cannot read the prototxt: No such file or directory"


def test_a_full_disk_ends_the_log_not_the_training(work):
    errors = train("--max-iter 1 --log /dev/full").err
    assert errors.count("/dev/full: cannot continue the log: No space left on device") == 1
    assert (work / "snapshots/net_iter_1.solverstate").exists()


@pytest.mark.parametrize(
    ("log", "message"),
    [
        ("solver.prototxt", READ),
        ("net.prototxt", READ),
        ("data/train.txt", READ),
        ("data/train_000.h5", READ),
        ("mine.caffemodel", READ),
        ("link.log", READ),
        ("locked.log", "another process is writing this log"),
        ("net.prototxt/a.log", "cannot write the log: "),
        (".", "cannot write the log: Is a directory"),
    ],
)
def test_a_log_that_cannot_be_written(work, small_data, log, message):
    """A log that is an input of the training run, or cannot be written, is rejected on one line
    and not changed.
    """
    shutil.copytree(small_data, "data")
    Path("data/train.txt").write_text("data/train_000.h5\n")
    net = Path("net.prototxt").read_text().replace(f"{small_data}/train.txt", "data/train.txt")
    Path("net.prototxt").write_text(net)
    netlib.Net("net.prototxt", netlib.TRAIN).save("mine.caffemodel")
    Path("link.log").symlink_to("solver.prototxt")
    before = {path: path.read_bytes() for path in work.rglob("*") if path.is_file()}
    with open("locked.log", "w") as other:
        assert locks.take(other.fileno())
        assert mistake(f"--weights mine.caffemodel --log {log}").startswith(f"{log}: {message}")
    assert {path: path.read_bytes() for path in before} == before


def test_a_training_that_does_not_begin_leaves_an_older_log_alone(work):
    """A start that fails, a second training of the same snapshots, and one that cannot write them
    do not touch it.
    """
    Path("old.log").write_text("old")
    Path("snapshots").mkdir()
    with locks.held(work / "snapshots" / ".net.netlib.lock"):
        assert "another training is writing" in mistake("--log old.log")
    Path("snapshots").rmdir()
    Path("snapshots").touch()
    assert "cannot write snapshots there" in train("--log old.log", status=1).err.splitlines()[-1]
    Path("solver.prototxt").unlink()
    for log in ("old.log", "new/new.log"):
        mistake(f"--log {log}")
    assert Path("old.log").read_text() == "old"
    assert not Path("new").exists()


def test_a_full_disk_leaves_only_whole_lines_in_the_log(tmp_path, monkeypatch, capsys):
    """One message reports the error."""
    path, log = tmp_path / "a.log", logging.getLogger("netlib")
    with training_log.logged(ALONE, path) as console:
        console.file.begin(())
        log.info("whole")
        whole, stream = path.read_bytes(), console.file.stream

        def cut(text):
            stream.buffer.write(text.encode()[:9])
            stream.buffer.flush()
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(stream, "write", cut)
        log.info("cut")
        log.info("on stderr only")
    assert path.read_bytes() == whole
    assert whole.endswith(b"whole\n")
    assert capsys.readouterr().err.count("cannot continue the log: No space left on device") == 1
