"""tools/table1.py: the paper's five networks on a few synthetic hands, two iterations each."""

import contextlib
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

import netlib
from handpose.experiments.principal_components import write_components
from handpose.experiments.results import Answers, angles_of, result_of
from handpose.experiments.true_angles import fit_true_angles
from handpose.scoring.held_out import Predictions
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError
from tools import table1, training

pytest.importorskip("matplotlib")

SKELETON = skeletons.load()
NAMES = ["direct_joint", "direct_parameter", "no_limit", "ours", "bottleneck"]
PICTURES = ["table1_joints.png", "table1_angles.png", "table1_hands.jpg"]


@pytest.fixture(scope="module", autouse=True)
def place(small_data, tmp_path_factory):
    """A working directory with data/nyu. The networks are narrow there, and their batches 16 and 10."""
    folder = tmp_path_factory.mktemp("table1")
    (folder / "data" / "nyu").mkdir(parents=True)
    for split in ("train", "test"):
        (folder / "data" / "nyu" / f"{split}.txt").write_text((small_data / f"{split}.txt").read_text())
    networks = []
    for network in table1.NETWORKS:
        text = network.model.read_text()
        for old, new in {"num_output: 1024": "32", "batch_size: 512": "16", "batch_size: 250": "10"}.items():
            text = text.replace(old, f"{old.split()[0]} {new}")
        networks.append(replace(network, model=folder / network.model.name))
        networks[-1].model.write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(table1, "NETWORKS", tuple(networks))
        yield folder


def run(*options, iterations=2):
    """Exit status, standard output and standard error of the tool."""
    arguments = ["--iterations", str(iterations), "--out", "results", "--work", "snapshots", *options]
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        status = table1.main(arguments)
    return status, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def first(place):
    """The first run: its output, and its messages."""
    status, out, err = run()
    assert status == 0
    return out, err


def weights(path):
    """All arrays of a snapshot."""
    with h5py.File(path) as file:
        return {f"{layer}/{i}": group[i][...] for layer, group in file["data"].items() for i in group}


# -------------------------------------------------------------------------------------------- the page


def test_the_table(first, place):
    """One row per network, in the paper's order, with the paper's figures; how it was made. It is also printed."""
    page = (place / "results" / "table1.md").read_text()
    assert first[0] == page + "\n"
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| ")]
    titles = [row[0] for row in rows]
    assert titles == ["network", *(network.title for network in table1.NETWORKS)]
    for row, network in zip(rows[1:], table1.NETWORKS):
        assert re.fullmatch(r"\d+\.\d\d \d+\.\d\d° (–|\d+\.\d%) \d+\.\d%", " ".join(row[1:5])), row
        assert (row[3] == "–") == network.by_fit, "networks without angles cannot break limits"
        assert row[5:] == (["–", "–"] if network.paper is None else [f"{network.paper[0]}", f"{network.paper[1]}°"])
    assert "`python tools/table1.py --iterations 2 --seed 1` (`make table1`) on data/nyu (synthetic)" in page
    assert "Scored on 24 held-out frames" in page and "The data are not the paper's" in page


def test_the_figures_are_in_a_file(first, place):
    """The same numbers, unrounded, with all that they depend on."""
    figures = json.loads((place / "results" / "table1.json").read_text())
    facts = {name: figures[name] for name in ("iterations", "seed", "data", "frames")}
    assert facts == {"iterations": 2, "seed": 1, "data": "synthetic", "frames": 24}
    assert list(figures["networks"]) == NAMES
    page = (place / "results" / "table1.md").read_text()
    for network, found in zip(table1.NETWORKS, figures["networks"].values()):
        assert f"| {network.title} | {found['error_14_mm']:.2f} | {found['angle_deg']:.2f}° |" in page
        assert 5 < found["error_mm"] < 200 and 1 < found["angle_deg"] < 180


def test_the_pictures(first, place):
    """Those that the page shows."""
    page = (place / "results" / "table1.md").read_text()
    assert re.findall(r"!\[.*\]\((.*)\)", page) == PICTURES
    for name in PICTURES:
        assert cv2.imread(str(place / "results" / name)) is not None


# -------------------------------------------------------------------------------------- training, once


def test_what_is_done(first):
    """Angles first, then the networks one after the other; only DeepPrior's starts from principal components."""
    lines = [line for line in first[1].splitlines() if re.match("train|test", line)]
    assert re.match(r"train: the hand fitted to 64 frames, \d\.\d\d mm left", lines[0])
    assert re.match(r"test: the hand fitted to 24 frames, \d\.\d\d mm left", lines[1])
    titles = [re.match("training (.*): ", line)[1] for line in lines[2:]]
    assert titles == [network.title for network in table1.NETWORKS]
    started = [line for line in lines if "--weights" in line]
    assert started == lines[-1:]
    assert re.search(r"--weights snapshots/synthetic_[0-9a-f]{8}/principal_components.caffemodel.h5$", started[0])


def test_a_second_run_trains_nothing(first, place, monkeypatch):
    """And fits nothing: what is there is kept, and the figures are the same."""
    monkeypatch.setattr(training, "train", lambda solver, **options: pytest.fail(f"trains {solver}"))
    made = [*place.glob("snapshots/*/*.h5"), *place.glob("data/nyu_angles/*.h5")]
    assert len(made) == 2 * 2 * 5 + 1 + 2  # weights and states of two iterations, components, angles
    before = [path.stat().st_mtime_ns for path in made]
    figures = (place / "results" / "table1.json").read_text()
    status, out, err = run()
    assert (status, out) == (0, first[0]) and "training" not in err
    assert [path.stat().st_mtime_ns for path in made] == before
    assert (place / "results" / "table1.json").read_text() == figures


@pytest.fixture
def only_ours(monkeypatch):
    """One network."""
    monkeypatch.setattr(table1, "NETWORKS", tuple(n for n in table1.NETWORKS if n.name == "ours"))


def test_a_stopped_run_goes_on_where_it_was(place, only_ours, tmp_path, monkeypatch):
    """From the last snapshot, by number and not by name; in the end the weights are those of a run in one go."""
    final = "ours_seed1_of12_iter_12.caffemodel.h5"
    in_one_go = ["--work", str(tmp_path / "one"), "--out", str(tmp_path / "one")]
    stopped = ["--work", str(tmp_path / "two"), "--out", str(tmp_path / "two")]
    assert run(*in_one_go, iterations=12)[0] == 0

    def until_10(solver, whole=training.train, **options):
        assert whole(solver, **options, max_iter=10) == 0
        return 130  # as Ctrl-C

    with monkeypatch.context() as patch:
        patch.setattr(training, "train", until_10)
        assert run(*stopped, iterations=12)[:2] == (130, "")
    assert not (tmp_path / "two" / "table1.md").exists()
    status, _, err = run(*stopped, iterations=12)
    (ten,) = tmp_path.glob("two/*/ours_seed1_of12_iter_10.solverstate.h5")
    assert status == 0 and f"--snapshot {ten}" in err
    whole, resumed = (weights(*tmp_path.glob(f"{name}/*/{final}")) for name in ("one", "two"))
    assert all(np.array_equal(whole[name], resumed[name]) for name in whole)
    logs = sorted(path.name for path in tmp_path.glob("two/*/*.log"))
    assert len(logs) == 2, "the log of the first part is not written over"


def test_it_follows_netlib_engine(place, only_ours, tmp_path, monkeypatch):
    """It has no --engine of its own."""
    monkeypatch.setenv("NETLIB_ENGINE", "plain")
    assert run("--work", str(tmp_path), "--out", str(tmp_path), iterations=1)[0] == 0
    (log,) = tmp_path.glob("*/ours_seed1_of1.log")
    assert ", engine plain. BLAS: " in log.read_text().splitlines()[0]


def test_other_seeds_and_iterations_are_other_trainings(first, place, only_ours):
    """Beside those that are there."""
    status, _, err = run("--seed", "2")
    assert status == 0 and "training ours: " in err
    assert {path.name for path in place.glob("snapshots/*/ours_seed*_iter_2.caffemodel.h5")} == {
        "ours_seed1_of2_iter_2.caffemodel.h5",
        "ours_seed2_of2_iter_2.caffemodel.h5",
    }


# ------------------------------------------------------------------------------------------- the parts


def test_the_network_with_the_bottleneck_starts_from_principal_components(place, tmp_path):
    """They are the weights of its layer "joints"; all others are random."""
    files = [Path(line) for line in (place / "data" / "nyu" / "train.txt").read_text().split()]
    write_components(tmp_path / "components.caffemodel.h5", files)
    net = netlib.Net(place / "bottleneck.prototxt", netlib.TRAIN)
    ignored, own = net.copy_from(tmp_path / "components.caffemodel.h5")
    assert not ignored and own == ["convL1", "convL2", "convL3", "FC1", "FC2", "bottleneck"]
    arrays = weights(tmp_path / "components.caffemodel.h5")
    for i, blob in enumerate(net.params["joints"]):
        assert np.array_equal(blob.data, arrays[f"joints/{i}"])


def test_angles_and_figures_of_a_perfect_network(first, place):
    """The true joints, with the true angles or with fitted ones: no error, but for angles that joints leave open."""
    files = [Path(line) for line in (place / "data" / "nyu" / "test.txt").read_text().split()]
    truth, _ = fit_true_angles("test", files, place / "data" / "nyu_angles", SKELETON)
    joints = kinematics_of(SKELETON).joints(truth)
    perfect = Predictions(joints, joints, truth, joints, np.full(len(truth), 150.0), {}, "a test")
    found = []
    for predictions in (perfect, replace(perfect, dof=None)):
        answers = Answers(table1.NETWORKS[0], predictions, angles_of(predictions, SKELETON))
        found.append(result_of(answers, truth, SKELETON))
    own, fitted = found
    assert (own.error_mm, own.error_14_mm, own.within_40_mm) == pytest.approx((0, 0, 1))
    assert own.angle_deg == pytest.approx(0, abs=1e-5) and own.out_of_limits == 0
    assert fitted.error_mm == 0 and fitted.angle_deg < 2 and fitted.out_of_limits is None


# -------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize("there", [[], ["train.txt"]], ids=["no data", "no test data"])
def test_without_data_a_line_says_how_to_make_them(tmp_path, monkeypatch, there):
    """Both ways; nothing is trained."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data" / "nyu").mkdir(parents=True)
    for name in there:
        (tmp_path / "data" / "nyu" / name).write_text(name)
    status, out, err = run()
    missing = "test" if there else "train"
    assert (status, out) == (1, "") and err.count("\n") == 1
    assert err.startswith(f"data/nyu/{missing}.txt: cannot read the list of HDF5 files: No such file or directory")
    assert "tools/make_synthetic.py" in err and "tools/prepare_nyu.py NYU_ROOT" in err


def test_a_training_that_fails_ends_the_run(place, tmp_path, monkeypatch):
    """With its exit status, and without a page."""
    monkeypatch.setattr(training, "train", lambda solver, **options: 1)
    assert run("--work", str(tmp_path), "--out", str(tmp_path))[:2] == (1, "")
    assert not (tmp_path / "table1.md").exists()


def test_an_error_in_a_training_is_one_line(place, tmp_path, monkeypatch):
    """And it ends the run."""

    def fail(solver, **options):
        raise DataError("data/nyu/train_000.h5: was cut")

    monkeypatch.setattr(training, "train", fail)
    status, out, err = run("--work", str(tmp_path), "--out", str(tmp_path))
    assert (status, out) == (1, "") and err.splitlines()[-1] == "data/nyu/train_000.h5: was cut"


def test_folders_that_cannot_be_made(tmp_path):
    """One line, before anything is done."""
    (tmp_path / "file").write_text("")
    for option in ("--work", "--out"):
        status, _, err = run(option, str(tmp_path / "file" / "folder"))
        assert status == 1 and err.startswith(f"{tmp_path}/file/folder: cannot make the folder: ")
        assert err.count("\n") == 1


@pytest.mark.parametrize("options", [["--iterations", "0"], ["--seed", "-1"], ["--networks", "ours"]], ids=" ".join)
def test_usage(options):
    """Wrong usage is argparse's own message and status 2."""
    with pytest.raises(SystemExit) as stopped:
        run(*options)
    assert stopped.value.code == 2
