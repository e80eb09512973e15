"""The figures of the experiments, on made input."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import netlib
from experiments import bench, parts
from experiments.example_nets import NETS, Example, Text, Workload, hand_deploy, hand_training, ordinary
from experiments.fit import auc, measure, scenes_of
from experiments.tracking import alone_of, cells_of, follow
from handpose.estimate.packaged import HAND_FINDER, load_predictor, rounded
from handpose.fit.body import CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.search import FAST
from handpose.frames.cameras import ICVL
from handpose.frames.recording import DepthFrame
from handpose.sequences.recordings import SyntheticRecording
from handpose.synthetic import recipes
from handpose.synthetic.generator import Generator
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib import fillers
from netlib.proto import prototxt
from tests.support.running import run_tool
from tests.support.tracked_hands import HEADER, tracked

# ---------------------------------------------------------------------------------------------- the fit, detection


def test_auc() -> None:
    """Of 2 failed and 3 good frames, 5 of the 6 pairs are in order; with only one kind the result is NaN."""
    score = np.array([1.0, 2, 3, 4, 5])
    assert auc(score, np.array([False, False, True, False, True])) == pytest.approx(5 / 6)
    assert np.isnan(auc(score, np.zeros(5, bool)))


def test_figures_of_the_packaged_network() -> None:
    """On unused frames of two cubes the fits beat the network and recognise the side; each cube has its fitter."""
    predictor, made = load_predictor(), []
    assert predictor.fitter is not None
    skeleton = predictor.fitter.model.skeleton

    def fitter_of(unit: float) -> DepthFitter:
        made.append(unit)
        return DepthFitter(CapsuleModel(skeleton, unit), predictor.fitter.errors)

    scenes = [*scenes_of(Generator(77, "test", recipes.recipe("one_hand")), 65)]
    found = measure(predictor.net, fitter_of, scenes, (FAST,), hands=True)
    assert made == [150, 130.5] and found.network.shape == (128,) and found.limbs.shape == (128, 20)
    fast = found.fits["fast"]
    assert np.median(fast.error) < 0.7 * np.median(found.network) and fast.right.mean() > 0.9
    assert fast.expected.shape == (128,) and ((fast.confidence >= 0) & (fast.confidence <= 1)).all()


def test_packaging_a_net_without_a_hand(tmp_path: Path) -> None:
    """Its weights are rounded and compressed only."""
    deploy, big, small = HAND_FINDER / "deploy.prototxt", tmp_path / "big.h5", tmp_path / "small.h5"
    net = netlib.Net(deploy, netlib.TEST, seed=1)
    net.save(big)
    run_tool("experiments.__main__", "package_model", big, "--model", deploy, "--out", small)
    again = netlib.Net(deploy, small, netlib.TEST)
    for name, blobs in net.params.items():
        np.testing.assert_array_equal(again.params[name][0].data, rounded(blobs[0].data, 10))


# ---------------------------------------------------------------------------------------------- tracks, gestures


class MadeRecording(SyntheticRecording):
    """A hand that moves 10 mm per frame and is absent in the last one."""

    def __init__(self) -> None:
        super().__init__("rest", HEADER.camera, rate=10, seconds=0.4)

    def frame(self, number: int) -> DepthFrame:
        return DepthFrame(number, number / 10, np.zeros((120, 160), np.float32))

    def truth(self, number: int) -> TrackedFrame:
        hands = (tracked(at=(10.0 * number, 0, 600)),) if number < 3 else ()
        return TrackedFrame(number, number / 10, hands)


class MadeTracker:
    """Reports each true hand with an offset of 3 mm; misses one frame, and reports a hand in a frame without one."""

    def header(self, source: str) -> TrackHeader:
        return HEADER

    def step(self, frame: DepthFrame) -> TrackedFrame:
        there = tracked(at=(10.0 * frame.number, 3.0, 600), id=7)
        return TrackedFrame(frame.number, frame.time, () if frame.number == 1 else (there,))


def alone(frame: DepthFrame, true: TrackedFrame) -> dict[int, np.ndarray]:
    """Finds all hands, with errors of 2 mm."""
    return {hand.id: np.full(len(hand.xyz), 2.0) for hand in true.hands}


def test_a_track_compared_with_single_frames() -> None:
    """Errors are compared where both find the hand."""
    done: list[int] = []
    found = follow(MadeRecording(), MadeTracker(), alone, progress=done.append)  # type: ignore[arg-type]
    assert (found.scores.frames, found.scores.invented, done) == (4, 1, [1, 1, 1, 1]) and found.seconds > 0
    (id,) = found.scores.hands
    assert found.both[id] == pytest.approx(np.array([[3, 2], [3, 2]]))
    assert cells_of(found, id)[:5] == ["3", "66.7%", "3.0", "3.0", "2.0"]
    every_third = follow(MadeRecording(), MadeTracker(), alone, every=3)  # type: ignore[arg-type]
    assert len(every_third.both[id]) == 1
    assert cells_of(follow(MadeRecording(), MadeTracker()), id)[3:5] == ["", ""]  # type: ignore[arg-type]


def test_single_frames_by_the_predictor() -> None:
    """A hand is found within 15 mm, and one at a wrong place is not found."""
    recording = SyntheticRecording("rest", ICVL, seconds=0.1, seed=3)
    frame, truth = recording.frame(0), recording.truth(0)
    look = alone_of(ICVL, "fast", None)
    assert look(frame, truth)[0].mean() < 15
    for change in ({"center_uvd": np.array([-5000.0, 0, 600])}, {"xyz": truth.hands[0].xyz + 200}):
        wrong = tuple(type(hand)(**{**vars(hand), **change}) for hand in truth.hands)
        assert look(frame, truth._replace(hands=wrong)) == {}


def test_true_joints_are_read_as_shown() -> None:
    """The true joints of a recording are recognised as the gestures shown."""
    done = run_tool("experiments.__main__", "gestures", "--truth", "--seconds", "6.5", "--seeds", "1", "--left")
    head, *rows, last = done.out.splitlines()
    columns = [slice(head.index(name) + len(name) - 3, head.index(name) + len(name)) for name in head.split()[2:]]
    shown = [row for row in rows if row.split()[1] != "0"]
    assert len(shown) >= 2
    for row in shown:
        percent = {name: int(row[at].strip() or 0) for name, at in zip(head.split()[2:], columns)}
        assert percent[row.split()[0]] > 90
    assert float(last.split("%")[0]) > 95


# ---------------------------------------------------------------------------------------------- benchmarks


def few_layers(net: Text) -> str:
    """A small net with every kind of layer that a peer translates."""
    x = net.pool(net.norm(net.conv("data", 8, 3, norm=True)), 3, 2)
    x = net.add("Concat", [net.conv(x, 4, 1), net.conv(x, 4, 3, pad=1, group=2)])
    x = net.add("Eltwise", [x, net.conv(x, 8, 3, pad=1, group=8, relu=False)])
    return net.product(net.pool(x, 0, 1, kind="AVE"), 5)


SMALL = (ordinary("few-layers", few_layers, 2, 3, 17, 17), Example("hand-2", hand_deploy, batch=2))
SMALL_TRAININGS = (NETS["LeNet"], Example("hand-training-4", hand_training(4), trains=True))


@pytest.mark.parametrize("example", SMALL, ids=lambda example: example.name)
def test_peers_compute_the_same(example: Example, tmp_path: Path, keep_threads: None) -> None:
    """The outputs of every installed peer agree with ours."""
    pytest.importorskip("onnx")
    names = [name.split()[0] for name, _ in bench.peers_of(example.name, Workload(example, tmp_path), 1)]
    assert names[0] == "OpenCV" and {"onnxruntime", "PyTorch"} >= set(names[1:])
    for package, peer in (("onnxruntime", "onnxruntime"), ("torch", "PyTorch")):
        assert (peer in names) == (find_spec(package) is not None)


@pytest.mark.parametrize("example", SMALL_TRAININGS, ids=lambda example: example.name)
def test_peers_have_the_same_gradients(example: Example, tmp_path: Path, keep_threads: None) -> None:
    pytest.importorskip("torch")
    jobs = dict(bench.peers_of(example.name, Workload(example, tmp_path), 1))
    assert list(jobs) == ["PyTorch eager", "PyTorch channels_last"]
    for job in jobs.values():
        job()


def test_a_peer_that_differs(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench.agrees("a peer", np.ones(3), np.ones((1, 3)))
    assert not bench.agrees("a peer", np.ones(3), np.array([1, 1, 1.01]))
    assert "a peer is not timed: its values differ by 0.0099" in capsys.readouterr().err


@pytest.mark.parametrize("name", [name for name in NETS if not name.startswith("hand")])
def test_the_nets(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Each net has one output, and about as many parameters as published."""
    monkeypatch.setattr(fillers, "_draw", lambda array, draw: None)  # the values do not matter, and take seconds
    known = {"CaffeNet": 61.0, "GoogLeNet": 7.0, "SqueezeNet": 1.24, "MobileNet-v1": 4.25, "MobileNet-v2": 3.54,
             "ResNet-50": 25.6, "VGG-16": 138.4, "LeNet": 0.43, "CIFAR-10": 0.146}
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
        found.append(np.array(next(iter(work.net.params.values()))[0].data if again is None else again))
    return found


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[np.ndarray]]:
    """A folder with the nets, and their results with all parts."""
    folder = tmp_path_factory.mktemp("nets")
    return folder, results(folder, "fast")


@pytest.mark.parametrize("name", parts.parts_of_fast() if netlib.engine.has_fast() else [])
def test_without_a_part(name: str, compared: tuple[Path, list[np.ndarray]], monkeypatch: pytest.MonkeyPatch,
                        keep_threads: None) -> None:
    """Every part can be switched off, and the nets compute the same without it, up to rounding."""
    folder, expected = compared
    with parts.parts_of_fast()[name].off():
        for ours, wanted in zip(results(folder, "plain" if name == parts.FAST else "fast"), expected):
            np.testing.assert_allclose(ours, wanted, rtol=0, atol=1e-4 * np.abs(wanted).max())


@pytest.mark.skipif(not netlib.engine.has_fast(), reason="there is no fast/")
def test_the_ratios_of_a_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep_threads: None) -> None:
    """A part that saves half the time and a third of the memory has the ratios 2 and 1.5."""
    base = parts.Measured(NETS["LeNet"], tmp_path)
    base.peak = 100
    monkeypatch.setattr(base, "_peak_of", lambda engine: 150)
    seconds: Callable[[Workload, int], float] = lambda work, calls: 1.0 if work is base.work else 2.0  # noqa: E731
    monkeypatch.setattr(parts, "_seconds", seconds)
    assert base.without("fusing", parts.parts_of_fast()["fusing"], 3, 0.1) == (2.0, 1.5)
