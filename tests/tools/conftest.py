"""A folder with a small data set, the paper's network with fewer features, and a solver."""

import contextlib
import os
from pathlib import Path

import pytest

from handpose.frames.cameras import ICVL
from handpose.frames.writing import RecordingWriter
from handpose.sequences.recordings import SyntheticRecording
from netlib import engine
from tests.support.running import ROOT
from tests.support.tables import pairs_of
from tools import make_synthetic
from tools.common import training

COUNT = 6  # frames of a recording
MISTAKES = Path(__file__).parent / "mistakes"

SOLVER = """
net: "net.prototxt"
base_lr: 0.003 momentum: 0.9 lr_policy: "fixed"
max_iter: 6 display: 2 average_loss: 2
test_iter: 2 test_interval: 3
snapshot: 3 snapshot_prefix: "snapshots/net"
random_seed: 1
"""


def mistakes_of(table):
    """Parametrize a test by the rows of a table: arguments, and the error that they cause."""
    rows = [(argv, line) for [argv], line in pairs_of(MISTAKES / f"{table}.txt")]
    return pytest.mark.parametrize(("argv", "message"), rows)


@pytest.fixture(scope="session")
def small_data(tmp_path_factory):
    """Generate 64 training and 24 test frames."""
    out = tmp_path_factory.mktemp("data") / "nyu"
    assert (
        make_synthetic.main(["--out", str(out), "--train", "64", "--test", "24", "--workers", "1"])
        == 0
    )
    return out


@pytest.fixture
def work(here, small_data):
    """Make a folder with net.prototxt and solver.prototxt the working directory."""
    net = (ROOT / "prototxt" / "nyu_train_test.prototxt").read_text()
    net = net.replace("data/nyu", str(small_data)).replace("batch_size: 512", "batch_size: 16")
    net = net.replace("num_output: 1024", "num_output: 64")
    (here / "net.prototxt").write_text(net.replace("batch_size: 250", "batch_size: 10"))
    (here / "solver.prototxt").write_text(SOLVER)
    return here


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """A folder with two recordings of a hand at rest: take.npz, and slow.npz with an hour
    between its frames.
    """
    folder = tmp_path_factory.mktemp("recorded")
    recording = SyntheticRecording("rest", ICVL, rate=15, seconds=COUNT / 15)
    for name, rate in (("take.npz", recording.rate), ("slow.npz", 1 / 3600)):
        with RecordingWriter(folder / name, recording.camera, recording.unit_mm, rate) as writer:
            for frame in recording:
                writer.write(frame._replace(time=frame.number / rate))
    return folder


@pytest.fixture
def signal_at_start(monkeypatch):
    """``signal_at_start(number)``: this process gets the signal when the next training begins."""
    original = training.requests_by_signal

    def arm(number):
        @contextlib.contextmanager
        def with_signal(*given):
            monkeypatch.setattr(training, "requests_by_signal", original)
            with original(*given) as stopped:
                os.kill(os.getpid(), number)
                yield stopped

        monkeypatch.setattr(training, "requests_by_signal", with_signal)

    return arm


@pytest.fixture
def other_engine(monkeypatch):
    """The fast engine while NETLIB_ENGINE selects the plain one; its number of threads is
    restored afterwards.
    """
    if not engine.has_fast():
        pytest.skip("the plain engine has one thread")
    fast = engine.get("fast")
    before = fast.threads()
    monkeypatch.setenv("NETLIB_ENGINE", "plain")
    yield fast
    fast.set_threads(before)
