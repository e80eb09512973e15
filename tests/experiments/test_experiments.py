"""python -m experiments: every experiment runs in its smallest form, and wrong usage is one line."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

import netlib
from experiments import fit
from experiments.__main__ import NAMES
from handpose.estimate.packaged import SYNTHETIC_HAND, read_card
from handpose.synthetic import generator
from tests.support.running import Done, run_tool
from tools import make_synthetic

RECORDING = ["--cameras", "icvl", "--seconds", "0.3"]
DEPLOY = str(SYNTHETIC_HAND / "deploy.prototxt")


def run(*words: object, status: int = 0) -> Done:
    return run_tool("experiments.__main__", *words, status=status)


def test_the_list() -> None:
    """Without a name, each experiment has a line; there is none that is not listed."""
    lines = run().out.splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == list(NAMES)
    assert all(len(line.split()) > 5 for line in lines if line.startswith("  "))
    folder = Path(importlib.import_module("experiments").__file__ or "").parent
    others = {"__init__", "__main__", "example_nets", "torch_nets"}
    assert {path.stem for path in folder.glob("*.py")} - others == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_help_is_the_docstring(name: str) -> None:
    module = importlib.import_module(f"experiments.{name}")
    assert (module.__doc__ or "").strip() in run(name, "--help").out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("tabel1", "unknown experiment 'tabel1' (did you mean 'table1'?); expected table1, bench"),
        ("bench --rounds 0", "bench: error: argument --rounds: expected an integer of at least 1, found '0'"),
        ("bench --nets gone", "bench: error: argument --nets: invalid choice: 'gone'"),
        ("parts --burst 0", "parts: error: argument --burst: expected a number greater than 0, found '0'"),
        ("table1", "table1: error: the following arguments are required: NETWORK"),
        ("table1 ours --iterations 1", "--iterations: expected an integer of at least 2"),
        ("fit --network a", "fit: error: argument --network: expected 2 arguments"),
        ("fit --seed 4294967296", "--seed: expected an integer of at most 4294967295"),
        ("tracking --scripts rest --rate 1e300", "--rate: expected a number greater than 1e-06 and at most"),
        ("package_model a --model b --out c --bits 24", "--bits: expected an integer of at most 23"),
    ],
)
def test_wrong_usage_is_one_line(words: str, message: str) -> None:
    done = run(*words.split(), status=2)
    assert done.err.startswith("python -m experiments") and message in done.err
    assert done.err.count("\n") == 1 and done.out == ""


# ---------------------------------------------------------------------------------------------- smallest forms


def test_bench(keep_threads: None) -> None:
    """Our time is measured without any peer; a ratio is the peer's time divided by ours."""
    done = run("bench", "--nets", "LeNet", "hand-1", "--rounds", "1", "--threads", "1", "--cpu")
    rows = [line.split() for line in done.out.splitlines()[2:]]
    assert {row[0] for row in rows} == {"LeNet", "hand-1"} and all(float(row[1]) > 0 for row in rows)
    for row in (row for row in rows if len(row) > 2):
        assert float(row[-1]) == pytest.approx(float(row[-2]) / float(row[1]), abs=0.02 + 0.02 * float(row[-1]))


@pytest.mark.skipif(not netlib.engine.has_fast(), reason="there is no fast/")
def test_parts(keep_threads: None) -> None:
    """A named part has a row with the ratios of time and memory."""
    done = run("parts", "--nets", "LeNet", "--parts", "fast Pooling", "RowWinograd", "fast HandModel", "--rounds", "1",
               "--burst", "1e-9")
    title, head, *rows = done.out.splitlines()
    assert title.startswith("LeNet: ") and head.split()[-2:] == ["time", "memory"]
    assert [row.split()[:-2] for row in rows if row] == [["fast", "Pooling"], ["RowWinograd"]]  # it has no HandModel
    assert all(float(cell) > 0 for row in rows if row for cell in row.split()[-2:])


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Generate 24 frames at a time instead of 64."""
    for module in (generator, fit):
        monkeypatch.setattr(module, "BLOCK", 24)


def test_fit(small_blocks: None) -> None:
    """There is a row for the network and for each plan, with the fraction of right hands where it was requested."""
    done = run("fit", "--frames", "3", "--recipes", "nyu", "--plans", "fast", "--hands")
    first, head, network, fast = done.out.splitlines()
    assert first.startswith("24 frames per recipe, seed 0") and head.split()[-2:] == ["right", "ms"]
    assert network.split()[:2] == ["nyu", "network"] and fast.split()[:2] == ["nyu", "fast"]
    assert float(fast.split()[3]) < float(network.split()[3]), "median"
    assert float(fast.split()[-2].rstrip("%")) > 90


def test_tracking() -> None:
    """There is a row for each hand of both recordings, and a line for all."""
    done = run("tracking", "--scripts", "rest", "left", "--seeds", "3", "--rate", "10", "--frame-by-frame", *RECORDING)
    head, right, left, last = done.out.splitlines()
    assert head.split()[:6] == ["script", "camera", "seed", "hand", "in", "sight"]
    assert right.split()[:7] == ["rest", "icvl", "3", "0", "right", "3", "100.0%"]
    assert left.split()[:5] == ["left", "icvl", "3", "0", "left"]
    assert last.startswith("6 of 6 visible hands found, mean error ") and " 6 frames, " in last


def test_gestures() -> None:
    """The table has a row for each gesture, also where the recording is too short for any to be scored."""
    lines = run("gestures", *RECORDING).out.splitlines()
    assert len(lines) == 1 + 8 + 1 and lines[-1].startswith("0 frames are recognized correctly; ")


@pytest.fixture(scope="module")
def one_hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """64 training frames, and test frames of both hands."""
    folder = tmp_path_factory.mktemp("data") / "one_hand"
    options = ["--recipe", "one_hand", "--train", "64", "--test", "72", "--workers", "1"]
    assert make_synthetic.main([*options, "--out", str(folder)]) == 0
    return folder


def test_table1(one_hand: Path, tmp_path: Path, keep_threads: None) -> None:
    """A network is trained in two stages and scored; the second run only scores."""
    words = ["table1", "direct_parameter", "--data", one_hand, "--iterations", "4", "--work", tmp_path]
    first, head, row = run(*words).out.splitlines()
    assert first.startswith(f"72 test frames of {one_hand} (synthetic); ")
    assert row.split()[:4] == ["direct_parameter", "adam", "4", "1"] and "cube of 261" in head
    states = sorted(path.name for path in tmp_path.glob("*.solverstate.h5"))
    assert [name.partition("_iter_")[2] for name in states] == ["3.solverstate.h5", "4.solverstate.h5"]
    log = next(tmp_path.glob("*.log"))
    before = log.stat().st_mtime_ns
    assert run(*words).out.splitlines()[-1] == row and log.stat().st_mtime_ns == before
    (model,) = tmp_path.glob("*_net.prototxt")
    model.write_text(model.read_text().replace("batch_size: 64", "batch_size: 32"))
    assert "its snapshots are of another net; remove them, or choose another --work" in run(*words, status=1).err


def test_table1_of_a_bottleneck_with_the_papers_solver(one_hand: Path, tmp_path: Path, keep_threads: None) -> None:
    """The bottleneck starts from principal components; its angles are fitted to its joints."""
    words = ["--data", one_hand, "--recipe", "paper", "--iterations", "2", "--work", tmp_path]
    row = run("table1", "bottleneck", *words).out.splitlines()[-1].split()
    assert row[0] == "bottleneck" and float(row[4]) < 150 and row[-2] == "–"
    weights = tmp_path / "one_hand_bottleneck_paper_2_seed1_components.caffemodel.h5"
    assert weights.is_file()


def test_table1_without_data(tmp_path: Path) -> None:
    done = run("table1", "ours", "--data", tmp_path / "gone", status=1)
    assert done.err.count("\n") == 1 and f"make_synthetic.py --recipe one_hand --out {tmp_path / 'gone'}" in done.err
    done = run("table1", "direct_parameter_exact", "--setting", "nyu", status=1)
    assert done.err.startswith("direct_parameter_exact: the exact angles of NYU's frames are unknown")


def test_package_model(tmp_path: Path, small_blocks: None) -> None:
    """The packaged file is smaller, and the fit reads it with its error tables; a place for it is checked first."""
    big, small = tmp_path / "big.caffemodel.h5", tmp_path / "small.caffemodel.h5"
    netlib.Net(DEPLOY, read_card(SYNTHETIC_HAND).weights, netlib.TEST).save(big)
    out = run("package_model", big, "--model", DEPLOY, "--out", small, "--bits", "6", "--frames", "1").out
    assert "24 frames of the recipe people: network " in out and "with 6 bits " in out
    assert small.stat().st_size < 0.5 * big.stat().st_size
    run("fit", "--network", small, DEPLOY, "--frames", "1", "--recipes", "nyu", "--plans", "fast")
    done = run("package_model", big, "--model", DEPLOY, "--out", big, status=1)
    assert done.err.count("\n") == 1 and str(big) in done.err
