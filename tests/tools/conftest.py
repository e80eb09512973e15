"""A folder with a small data set, the paper's network with fewer features, and a solver."""

from pathlib import Path

import pytest

from netlib import engine
from tools import make_synthetic

ROOT = Path(__file__).resolve().parents[2]

SOLVER = """
net: "net.prototxt"
base_lr: 0.003 momentum: 0.9 lr_policy: "fixed"
max_iter: 6 display: 2 average_loss: 2
test_iter: 2 test_interval: 3
snapshot: 3 snapshot_prefix: "snapshots/net"
random_seed: 1
"""


@pytest.fixture(scope="session")
def small_data(tmp_path_factory):
    """Generate 64 training and 24 test frames."""
    out = tmp_path_factory.mktemp("data") / "nyu"
    assert make_synthetic.main(["--out", str(out), "--train", "64", "--test", "24", "--workers", "1"]) == 0
    return out


@pytest.fixture
def work(tmp_path, monkeypatch, small_data):
    """Make a folder with net.prototxt and solver.prototxt the working directory."""
    net = (ROOT / "prototxt" / "nyu_train_test.prototxt").read_text()
    net = net.replace("data/nyu", str(small_data)).replace("batch_size: 512", "batch_size: 16")
    net = net.replace("num_output: 1024", "num_output: 64")
    (tmp_path / "net.prototxt").write_text(net.replace("batch_size: 250", "batch_size: 10"))
    (tmp_path / "solver.prototxt").write_text(SOLVER)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def other_engine(monkeypatch):
    """The fast engine while NETLIB_ENGINE selects the plain one; its number of threads is restored afterwards."""
    if not engine.has_fast():
        pytest.skip("the plain engine has one thread")
    fast = engine.get("fast")
    before = fast.threads()
    monkeypatch.setenv("NETLIB_ENGINE", "plain")
    yield fast
    fast.set_threads(before)
