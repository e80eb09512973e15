"""python -m experiments: every experiment runs in its smallest form; its figures, on made input."""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import netlib
from experiments import fit, parts, peers
from experiments.__main__ import NAMES
from experiments.example_nets import NETS, Example, hand_deploy, hand_training, ordinary
from experiments.net_builder import NetBuilder
from experiments.package_model import rounded
from experiments.tracking import cells_of, follow
from experiments.workload import Workload
from handpose.estimate.packaged import HAND_FINDER, SYNTHETIC_HAND, read_card
from handpose.frames.recording import DepthFrame
from handpose.sequences.recordings import SyntheticRecording
from handpose.synthetic import generator
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib import fillers
from netlib.proto import prototxt
from tests.support.running import Done, run_tool
from tests.support.tracked_hands import HEADER, tracked

DEPLOY = str(SYNTHETIC_HAND / "deploy.prototxt")


def run(command: str = "", *words: object, status: int = 0) -> Done:
    return run_tool(f"experiments.__main__ {command}", *words, status=status)


def test_the_list() -> None:
    """Without a name, each experiment has a line; there is none that is not listed."""
    lines = run().out.splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == list(NAMES)
    assert all(len(line.split()) > 5 for line in lines if line.startswith("  "))
    folder = Path(importlib.import_module("experiments").__file__ or "").parent
    nets = {"example_nets", "net_builder", "peers", "table1_nets", "torch_nets", "workload"}
    frames = {"confidence_poses", "hidden_parts", "labelled_frames"}
    others = nets | frames | {"__init__", "__main__", "choices", "tables"}
    assert {path.stem for path in folder.glob("*.py")} - others == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_help_is_the_docstring(name: str) -> None:
    module = importlib.import_module(f"experiments.{name}")
    assert (module.__doc__ or "").strip() in run(name, "--help").out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("tabel1", "unknown experiment 'tabel1' (did you mean 'table1'?); expected table1, bench"),
        (
            "bench --rounds 0",
            "bench: error: argument --rounds: expected an integer of at least 1, found '0'",
        ),
        ("table1", "table1: error: the following arguments are required: NETWORK"),
    ],
)
def test_wrong_usage_is_one_line(words: str, message: str) -> None:
    done = run(words, status=2)
    assert done.err.startswith("python -m experiments") and message in done.err
    assert done.err.count("\n") == 1 and done.out == ""


def test_bench(keep_threads: None) -> None:
    """Our time is measured without any peer; a ratio is the peer's time divided by ours."""
    done = run("bench", "--nets", "LeNet", "hand-1", "--rounds", "1", "--threads", "1", "--cpu")
    rows = [line.split() for line in done.out.splitlines()[2:]]
    assert {row[0] for row in rows} == {"LeNet", "hand-1"}
    assert all(float(row[1]) > 0 for row in rows)
    for row in (row for row in rows if len(row) > 2):
        assert float(row[-1]) == pytest.approx(
            float(row[-2]) / float(row[1]), abs=0.02 + 0.02 * float(row[-1])
        )


@pytest.mark.skipif(not netlib.engine.has_fast(), reason="there is no fast/")
def test_parts(keep_threads: None) -> None:
    """A named part has a row with the ratios of time and memory."""
    done = run(
        "parts",
        "--nets",
        "LeNet",
        "--parts",
        "fast Pooling",
        "RowWinograd",
        "fast HandModel",
        "--rounds",
        "1",
        "--burst",
        "1e-9",
    )
    title, head, *rows = done.out.splitlines()
    assert title.startswith("LeNet: ") and head.split()[-2:] == ["time", "memory"]
    # it has no HandModel
    assert [row.split()[:-2] for row in rows if row] == [["fast", "Pooling"], ["RowWinograd"]]
    assert all(float(cell) > 0 for row in rows if row for cell in row.split()[-2:])


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Generate 24 frames at a time instead of 64."""
    for module in (generator, fit):
        monkeypatch.setattr(module, "BLOCK", 24)


def test_fit(small_blocks: None) -> None:
    """There is a row for the network and for each plan, with the fraction of right hands where it
    was requested.
    """
    done = run("fit --frames 3 --recipes nyu --plans fast --hands")
    first, head, network, fast = done.out.splitlines()
    assert first.startswith("24 frames per recipe, seed 0") and head.split()[-2:] == ["right", "ms"]
    assert network.split()[:2] == ["nyu", "network"] and fast.split()[:2] == ["nyu", "fast"]
    assert float(fast.split()[3]) < 0.7 * float(network.split()[3]), "median"
    assert float(fast.split()[-2].rstrip("%")) > 90


def test_tracking() -> None:
    """There is a row for each hand of both recordings, and a line for all."""
    recording = "--scripts rest left --seeds 3 --cameras icvl --rate 10 --seconds 0.3"
    done = run(f"tracking {recording}")
    head, right, left, last = done.out.splitlines()
    assert head.split()[:6] == ["script", "camera", "seed", "hand", "in", "sight"]
    assert right.split()[:7] == ["rest", "icvl", "3", "0", "right", "3", "100.0%"]
    assert left.split()[:5] == ["left", "icvl", "3", "0", "left"]
    assert float(right.split()[7]) < 20
    assert last.startswith("6 of 6 visible hands found, mean error ") and " 6 frames, " in last


@pytest.fixture(scope="module")
def one_hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """64 training frames, and test frames of both hands."""
    folder = tmp_path_factory.mktemp("data") / "one_hand"
    options = "--recipe one_hand --train 64 --test 72 --workers 1"
    run_tool(f"make_synthetic {options} --out {folder}")
    return folder


def test_table1(one_hand: Path, tmp_path: Path, keep_threads: None) -> None:
    """A network is trained in two stages and scored; the second run only scores."""
    command = f"table1 direct_parameter --data {one_hand} --iterations 4 --work {tmp_path}"
    first, head, row = run(command).out.splitlines()
    assert first.startswith(f"72 test frames of {one_hand} (synthetic); ")
    assert row.split()[:4] == ["direct_parameter", "adam", "4", "1"] and "cube of 261" in head
    states = sorted(path.name for path in tmp_path.glob("*.solverstate.h5"))
    assert [name.partition("_iter_")[2] for name in states] == [
        "3.solverstate.h5",
        "4.solverstate.h5",
    ]
    log = next(tmp_path.glob("*.log"))
    before = log.stat().st_mtime_ns
    assert run(command).out.splitlines()[-1] == row and log.stat().st_mtime_ns == before
    (model,) = tmp_path.glob("*_net.prototxt")
    model.write_text(model.read_text().replace("batch_size: 64", "batch_size: 32"))
    assert (
        "its snapshots are of another net; remove them, or choose another --work"
        in run(command, status=1).err
    )


def test_table1_of_a_bottleneck_with_the_papers_solver(
    one_hand: Path, tmp_path: Path, keep_threads: None
) -> None:
    """The bottleneck starts from principal components; its angles are fitted to its joints."""
    options = f"--data {one_hand} --recipe paper --iterations 2 --work {tmp_path}"
    row = run(f"table1 bottleneck {options}").out.splitlines()[-1].split()
    assert row[0] == "bottleneck" and float(row[4]) < 150 and row[-2] == "–"
    with h5py.File(tmp_path / "one_hand_bottleneck_paper_2_seed1_components.caffemodel.h5") as file:
        basis, mean = file["data/joints/0"][...], file["data/joints/1"][...]
    with h5py.File(one_hand / "train_000.h5") as file:
        joints = file["joint"][...]
    assert basis.shape == (93, 30) and mean == pytest.approx(joints.mean(axis=0), abs=1e-6)
    components = (joints - mean) @ np.linalg.pinv(basis).T
    assert components.std(axis=0) == pytest.approx(np.ones(30), abs=1e-3)


def test_table1_without_data(tmp_path: Path) -> None:
    done = run(f"table1 ours --data {tmp_path}/gone", status=1)
    assert done.err.count("\n") == 1
    assert f"make_synthetic.py --recipe one_hand --out {tmp_path / 'gone'}" in done.err
    done = run("table1 direct_parameter_exact --setting nyu", status=1)
    assert done.err.startswith(
        "direct_parameter_exact: the exact angles of NYU's frames are unknown"
    )


def test_package_model(tmp_path: Path, small_blocks: None) -> None:
    """The packaged file is smaller, and the fit reads it with its error tables; a place for it is
    checked first.
    """
    big, small = tmp_path / "big.caffemodel.h5", tmp_path / "small.caffemodel.h5"
    netlib.Net(DEPLOY, read_card(SYNTHETIC_HAND).weights, netlib.TEST).save(big)
    package = f"package_model {big} --model {DEPLOY} --out"
    out = run(f"{package} {small} --bits 6 --frames 1").out
    assert "24 frames of the recipe people: network " in out and "with 6 bits " in out
    assert small.stat().st_size < 0.5 * big.stat().st_size
    run(f"fit --network {small} {DEPLOY} --frames 1 --recipes nyu --plans fast")
    done = run(f"{package} {big}", status=1)
    assert done.err.count("\n") == 1 and str(big) in done.err


def test_packaging_a_net_without_a_hand(tmp_path: Path) -> None:
    """Its weights are rounded and compressed only."""
    deploy, big, small = HAND_FINDER / "deploy.prototxt", tmp_path / "big.h5", tmp_path / "small.h5"
    net = netlib.Net(deploy, netlib.TEST, seed=1)
    net.save(big)
    run(f"package_model {big} --model {deploy} --out {small}")
    again = netlib.Net(deploy, small, netlib.TEST)
    for name, blobs in net.params.items():
        assert_array_equal(again.params[name][0].data, rounded(blobs[0].data, 10))


# ------------------------------------------------------------------------------------------ figures


def test_auc() -> None:
    """Of 2 failed and 3 good frames, 5 of the 6 pairs are in order; with only one kind the
    result is NaN.
    """
    score = np.array([1.0, 2, 3, 4, 5])
    assert fit.auc(score, np.array([False, False, True, False, True])) == pytest.approx(5 / 6)
    assert np.isnan(fit.auc(score, np.zeros(5, bool)))


class MadeRecording(SyntheticRecording):
    """A hand that moves 10 mm per frame and is absent in the last one."""

    def __init__(self) -> None:
        super().__init__("rest", HEADER.camera, rate=10, seconds=0.4)

    def truth(self, number: int) -> TrackedFrame:
        hands = (tracked(at=(10.0 * number, 0, 600)),) if number < 3 else ()
        return TrackedFrame(number, number / 10, hands)


class MadeTracker:
    """Reports each true hand with an offset of 3 mm; misses one frame, and reports a hand in a
    frame without one.
    """

    def header(self, source: str) -> TrackHeader:
        return HEADER

    def step(self, frame: DepthFrame) -> TrackedFrame:
        there = tracked(at=(10.0 * frame.number, 3.0, 600), id=7)
        return TrackedFrame(frame.number, frame.time, () if frame.number == 1 else (there,))


def test_a_track_is_scored() -> None:
    done: list[int] = []
    found = follow(MadeRecording(), MadeTracker(), done.append)  # type: ignore[arg-type]
    assert (found.scores.frames, found.scores.invented, done) == (4, 1, [1, 1, 1, 1])
    assert found.seconds > 0
    (hand,) = found.scores.hands.values()
    assert [*cells_of(hand).values()][:3] == ["3", "66.7%", "3.0"]


# --------------------------------------------------------------------------------------- benchmarks


def few_layers(net: NetBuilder) -> str:
    """A small net with every kind of layer that a peer translates."""
    x = net.pool(net.lrn(net.conv("data", 8, 3, batch_norm=True)), 3, 2)
    x = net.add("Concat", [net.conv(x, 4, 1), net.conv(x, 4, 3, pad=1, group=2)])
    x = net.add("Eltwise", [x, net.conv(x, 8, 3, pad=1, group=8, relu=False)])
    return net.product(net.pool(x, 0, 1, kind="AVE"), 5)


SMALL = (ordinary("few-layers", few_layers, 2, 3, 17, 17), Example("hand-2", hand_deploy, batch=2))
SMALL_TRAININGS = (NETS["LeNet"], Example("hand-training-4", hand_training(4), trains=True))


@pytest.mark.parametrize("example", [*SMALL, *SMALL_TRAININGS], ids=lambda example: example.name)
def test_peers_compute_the_same(example: Example, tmp_path: Path, keep_threads: None) -> None:
    """The outputs, or the gradients, of every installed peer agree with ours."""
    pytest.importorskip("onnx")
    jobs = dict(peers.peers_of(example.name, Workload(example, tmp_path), 1))
    expected = [
        (f"OpenCV {cv2.__version__}", "cv2"),
        ("onnxruntime", "onnxruntime"),
        ("PyTorch", "torch"),
    ]
    if example.trains:
        expected = [("PyTorch eager", "torch"), ("PyTorch channels_last", "torch")]
    assert list(jobs) == [peer for peer, package in expected if find_spec(package)]
    for job in jobs.values():
        job()


def test_a_peer_that_differs(capsys: pytest.CaptureFixture[str]) -> None:
    assert peers.agrees("a peer", np.ones(3), np.ones((1, 3)))
    assert not peers.agrees("a peer", np.ones(3), np.array([1, 1, 1.01]))
    assert "a peer is not timed: its values differ by 0.0099" in capsys.readouterr().err


@pytest.mark.parametrize("name", [name for name in NETS if not name.startswith("hand")])
def test_the_nets(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Each net has one output, and about as many parameters as published."""
    # the values do not matter, and take seconds
    monkeypatch.setattr(fillers, "_draw", lambda array, draw: None)
    known = {
        "CaffeNet": 61.0,
        "GoogLeNet": 7.0,
        "SqueezeNet": 1.24,
        "MobileNet-v1": 4.25,
        "MobileNet-v2": 3.54,
        "ResNet-50": 25.6,
        "VGG-16": 138.4,
        "LeNet": 0.43,
        "CIFAR-10": 0.146,
    }
    phase = netlib.TRAIN if NETS[name].trains else netlib.TEST
    net = netlib.Net(prototxt.parse(NETS[name].text(tmp_path)), phase)
    assert len(net.outputs) == 1
    count = sum(param.count for params in net.params.values() for param in params) / 1e6
    assert count == pytest.approx(known.get(name, count), rel=0.01)


def results(folder: Path, engine: str) -> list[np.ndarray]:
    """Outputs of the small nets in two passes, and weights of the small trainings after a step."""
    found = []
    for example in (*SMALL, *SMALL_TRAININGS):
        work = Workload(example, folder, engine)
        work.run()
        again = work.run()
        found.append(
            np.array(next(iter(work.net.params.values()))[0].data if again is None else again)
        )
    return found


@pytest.mark.skipif(not netlib.engine.has_fast(), reason="there is no fast/")
def test_switching_off_a_part_changes_only_rounding(tmp_path: Path, keep_threads: None) -> None:
    expected = results(tmp_path, "fast")
    for name, part in parts.parts_of_fast().items():
        with part.off():
            for ours, wanted in zip(
                results(tmp_path, "plain" if name == parts.FAST else "fast"), expected
            ):
                assert_allclose(
                    ours, wanted, rtol=0, atol=1e-4 * np.abs(wanted).max(), err_msg=name
                )


@pytest.mark.skipif(not netlib.engine.has_fast(), reason="there is no fast/")
def test_the_ratios_of_a_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep_threads: None
) -> None:
    """A part that saves half the time and a third of the memory has the ratios 2 and 1.5."""
    base = parts.Measured(NETS["LeNet"], tmp_path)
    base.peak = 100
    monkeypatch.setattr(base, "_peak_of", lambda engine: 150)

    def seconds(work: Workload, calls: int) -> float:
        return 1.0 if work is base.work else 2.0

    monkeypatch.setattr(parts, "_seconds", seconds)
    assert base.without("fusing", parts.parts_of_fast()["fusing"], 3, 0.1) == (2.0, 1.5)
