"""tools/table1.py with tools/common/ and experiments/, on few frames and narrow networks."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
import time
from dataclasses import replace

import cv2
import h5py
import numpy as np
import pytest

import netlib
from experiments.table1 import store, trainings
from experiments.table1.networks import LAMBDAS, NETWORKS
from experiments.table1.plan import Job
from experiments.table1.recipes import ADAM, PAPER
from experiments.table1.settings import MANY_HANDS, ONE_HAND, REAL
from experiments.table1.trainings import Training, data_name
from netlib.errors import DataError
from netlib.training.solver_parameter import read
from tests.support.made_store import entry, shown, trained
from tests.support.running import run_tool
from tools.common import campaign, outputs, training
from tools.common.campaign import Campaign

pytest.importorskip("matplotlib")

LENGTHS = (4, 6, 9)
RECIPES = {recipe.name: replace(recipe, lengths=LENGTHS, batch=8, every=2) for recipe in (PAPER, ADAM)}


@pytest.fixture(scope="module")
def setting(small_data):
    """64 training and 24 test frames of the first subject."""
    counts = {"train": 64, "test": 24}
    return replace(ONE_HAND, folder=small_data, recipe="nyu", counts=counts)


@pytest.fixture(scope="module")
def narrow(tmp_path_factory):
    """The networks by name, with 32 features instead of 1024."""
    folder, found = tmp_path_factory.mktemp("narrow"), {}
    for network in NETWORKS[:6]:
        path = folder / network.model.name
        path.write_text(network.model.read_text().replace("num_output: 1024", "num_output: 32"))
        found[network.name] = replace(network, model=path)
    return found


def sit(folder, jobs, **options):
    """Run a campaign; return its exit status, its messages and the campaign."""
    with contextlib.redirect_stderr(io.StringIO()) as err:
        one = Campaign(folder / "store", folder / "work", "a test", **options)
        status = one.run(jobs)
    return status, [line for line in err.getvalue().splitlines() if line.startswith(("[", "time is up"))], one


def weights(path):
    """Return all arrays of a snapshot."""
    with h5py.File(path) as file:
        return {f"{layer}/{i}": group[i][...] for layer, group in file["data"].items() for i in group}


def same(one, other):
    """Return whether all arrays of two weights files are equal bit for bit."""
    a, b = weights(one), weights(other)
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


# -------------------------------------------------------------------------------------------- training


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)
def test_trunk_and_end_are_a_training_in_one_go(setting, narrow, recipe, tmp_path):
    """Training a trunk and an end equals a single run, bit for bit, for two lengths that share the trunk."""
    one = Training(setting, narrow["ours"], recipe, 3, tmp_path)
    files = setting.files("train")
    for length in LENGTHS[:2]:
        steps = []
        while (step := one.next_step(length, files)) is not None:
            steps.append(step)
            with contextlib.redirect_stderr(io.StringIO()):
                assert training.train(step.solver, snapshot=step.snapshot) == 0
        trunk, end = steps
        assert (end.first, end.last) == (trunk.last, length) and trunk.first == (0 if length == 4 else 3)
        alone = netlib.get_solver(trunk.solver)
        alone.step(end.first)
        alone.param = dataclasses.replace(read(end.solver), weights=())
        alone.step(length - end.first)
        alone.net.save(tmp_path / "alone.caffemodel.h5")
        assert same(one.weights_of(length), tmp_path / "alone.caffemodel.h5")
    if not recipe.robust:  # then the end's solver equals that of the whole run
        whole = netlib.get_solver(end.solver)
        whole.step(length)
        whole.net.save(tmp_path / "whole.caffemodel.h5")
        assert same(one.weights_of(length), tmp_path / "whole.caffemodel.h5")


def test_every_network_is_trained_and_scored(setting, narrow, tmp_path):
    """Each network is trained and scored once, old snapshots are removed, and a second run does nothing."""
    jobs = [Job(setting, network, RECIPES["paper"], 1) for network in narrow.values()]
    status, said, _ = sit(tmp_path, jobs, longest=4)
    assert status == 0 and len(said) == 3 * len(jobs)
    assert ["principal_components" in line for line in said if ": 0 of " in line] == [
        network == "bottleneck" for network in narrow
    ]
    entries = {found.network: found for found in store.read_all(tmp_path / "store", "one_hand")}
    assert set(entries) == set(narrow)
    for name, found in entries.items():
        (subject,) = found.subjects
        assert (subject.subject, subject.frames, found.iterations) == ("same hand", 24, 4)
        assert 5 < found.error_mm < 300 and found.error_mm == pytest.approx(subject.error_14_mm, abs=1e-4)
        assert np.isnan(subject.out_of_limits) == narrow[name].by_fit and subject.angle_deg > 1
        assert found.seconds > 0 and found.made_from == "synthetic" and found.command == "a test"
    assert not list(tmp_path.glob("work/*/*_of4_iter_*")) and len(list(tmp_path.glob("work/*/*.solverstate.h5"))) == 6
    assert len(store.read_shown(tmp_path / "store", "one_hand").crops) == 4
    assert sit(tmp_path, jobs, longest=4)[:2] == (0, [])


def test_a_stopped_campaign_continues_where_it_was(setting, narrow, tmp_path, monkeypatch):
    """After a signal in the trunk, one in the end, and a time limit, the results equal those of a single run."""
    jobs = [Job(setting, narrow["ours"], RECIPES["adam"], 1)]
    assert sit(tmp_path / "one", jobs)[0] == 0
    whole, stops = training.train, [1, 4]

    def until(solver, watch, **options):
        last = stops.pop(0) if stops else None

        def stop(running):
            watch(running)
            running.requested = "stop" if last is not None and running.iter + 1 == last else running.requested

        status = whole(solver, watch=stop, **options)
        return status if last is None else 130

    monkeypatch.setattr(training, "train", until)
    assert [sit(tmp_path / "two", jobs)[0] for _ in range(2)] == [130, 130]
    clock = iter([0.0] * 4 + [9.0] * 9)
    monkeypatch.setattr(campaign, "time", type("Clock", (), {"monotonic": lambda: next(clock),
                                                             "perf_counter": time.perf_counter}))
    status, said, _ = sit(tmp_path / "two", jobs, deadline=5.0)
    assert status == 0 and said[-1] == "time is up; the next run continues here"
    monkeypatch.undo()
    assert sit(tmp_path / "two", jobs)[0] == 0
    one, two = (store.read_all(tmp_path / name / "store", "one_hand") for name in ("one", "two"))
    assert len(one) >= 2 and [repr(e.subjects) for e in one] == [repr(e.subjects) for e in two]  # NaN != NaN
    assert all(np.array_equal(a.shown, b.shown) for a, b in zip(one, two))


def test_time_that_is_up_while_frames_are_made(tmp_path, monkeypatch):
    """Making frames counts: after the deadline complete files are kept, and nothing is trained."""
    monkeypatch.chdir(tmp_path)
    counts = {"train": 2000, "test": 64}
    made = replace(ONE_HAND, folder=tmp_path / "frames", counts=counts)
    jobs = [Job(made, NETWORKS[0], RECIPES["paper"], 1)]
    one = Campaign(tmp_path / "store", tmp_path / "work", "a test")
    assert re.fullmatch(
        r"1 of 1 training runs are missing: an unknown time; first 2064 frames of 0\.1 GB are made", one.cost(jobs)
    )
    clock = iter([0.0, 0.0, *[9.0] * 99])
    monkeypatch.setattr(campaign, "time", type("Clock", (), {"monotonic": lambda: next(clock),
                                                             "perf_counter": time.perf_counter}))
    status, said, _ = sit(tmp_path, jobs, deadline=5.0)
    assert status == 0 and said == ["time is up; the next run continues here"]
    assert not (tmp_path / "work").exists() and not list((tmp_path / "frames").glob("*.h5"))


def test_what_is_done_costs_nothing(setting, narrow, tmp_path):
    """The cost counts what is missing; frames that are there are not made."""
    jobs = [Job(setting, narrow["ours"], RECIPES["paper"], seed) for seed in (1, 2)]
    assert sit(tmp_path, jobs[:1], longest=4)[0] == 0
    one = Campaign(tmp_path / "store", tmp_path / "work", "a test", longest=4)
    assert re.fullmatch(
        r"1 of 2 training runs are missing: about \d+\.\d hours on the machine of the results", one.cost(jobs)
    )


def test_a_scored_length_is_not_trained_again_elsewhere(setting, narrow, tmp_path):
    """Stored results are not computed again; the trunk is trained again up to the branch of the next length."""
    jobs = [Job(setting, narrow["ours"], RECIPES["paper"], 1)]
    assert sit(tmp_path, jobs, longest=4)[0] == 0
    (tmp_path / "work").rename(tmp_path / "elsewhere")
    status, said, _ = sit(tmp_path, jobs, longest=6)
    assert status == 0 and "0 of 6 iterations done" in said[0] and not any("of 4 iterations" in x for x in said)


def test_a_shorter_length_after_a_longer_one(setting, narrow, tmp_path):
    """After a longer run the trunk of a shorter one is trained from the start."""
    recipe = RECIPES["paper"]
    jobs = [Job(setting, narrow["ours"], recipe, 1, only) for only in (9, 4)]
    assert sit(tmp_path, jobs)[0] == 0
    assert [e.iterations for e in store.read_all(tmp_path / "store", "one_hand")] == [4, 9]


def test_a_store_of_other_data_is_refused(setting, narrow, tmp_path):
    """A store of other data is rejected on one line before training."""
    store.write(tmp_path / "store", entry("direct_joint"))
    with pytest.raises(DataError, match=r"store/one_hand: was made with the data synthetic_00000000, those in"):
        sit(tmp_path, [Job(setting, narrow["ours"], RECIPES["paper"], 1)])


def test_other_data_are_other_trainings(tmp_path):
    """Results of synthetic data and of NYU have different names, and other labels have other work folders."""
    path, names = tmp_path / "other.h5", []
    for made_from, recipe in (("synthetic", "a"), ("synthetic", "b"), ("NYU", "b")):
        with h5py.File(path, "w") as file:
            file.attrs.update(made_from=made_from, recipe=recipe)
        names.append(data_name([path]))
    assert len(set(names)) == 3 and names[2].startswith("nyu_")
    folders = {trainings.work_folder(tmp_path, ONE_HAND, "a", network).name for network in NETWORKS}
    assert folders == {"one_hand_a", "one_hand_a_ridge0.0003_v3"}


# -------------------------------------------------------------------------------------------- the command


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A store with invented results; the working directory is elsewhere."""
    monkeypatch.chdir(tmp_path)
    for where, recipe in ((ONE_HAND, PAPER), (ONE_HAND, ADAM), (MANY_HANDS, ADAM)):
        for one in trained(where, recipe):
            store.write(tmp_path / "store", one)
    for network in LAMBDAS:
        store.write(tmp_path / "store", entry(network.name, 17, 6000))
    store.write_shown(tmp_path / "store", "one_hand", shown())
    return tmp_path


def run(*options, status=None):
    """Run the tool on the store of the test."""
    return run_tool("table1", "--ledger", "store", "--out", "results", "--work", "work", *options, status=status)


def test_the_page_and_its_pictures(made, monkeypatch):
    """The page and all its pictures are written from the store alone."""
    write = outputs.write_figure
    monkeypatch.setattr(outputs, "write_figure", lambda path, figure, dpi: write(path, figure, dpi=20))
    assert run("--page")[0] == 0
    page = (made / "results" / "table1.md").read_text()
    found = re.findall(r"!\[.*\]\((.*)\)", page)
    assert len(found) == 7 and "**confirmed**" in page
    for name in found:
        assert cv2.imread(str(made / "results" / name)) is not None
    assert {path.name for path in (made / "results").iterdir()} == {*found, "table1.md"}


def test_the_list(made):
    """--list prints finished and missing runs and writes nothing."""
    status, out, _ = run("--list")
    assert status == 0 and re.search(r"one_hand: ours, adam, seed 2 +20000, 30000 .* done +–", out)
    _, more, _ = run("--list", "--seeds", "3")
    assert re.search(r"many_hands: ours_scale, adam, seed 3 +– +– +missing +\d+\.\d\n", more)
    assert not (made / "results").exists() and "in total" in out.splitlines()[-1]


def test_nyu_itself_is_taken_where_it_is(made):
    """data/nyu is used only if it holds NYU's frames."""
    assert "nyu:" not in run("--list")[1]
    (made / "data/nyu").mkdir(parents=True)
    for made_from, taken in (("synthetic", False), ("NYU", True)):
        with h5py.File(made / "data/nyu/a.h5", "w") as file:
            file.attrs["made_from"] = made_from
        (made / "data/nyu/train.txt").write_text("a.h5\n")
        assert ("nyu: ours, paper, seed 1" in run("--list")[1]) == taken
    assert REAL.name == "nyu"


def test_a_damaged_store_is_one_line(made):
    """A damaged store gives one line, and nothing is trained or written."""
    path = made / "store/one_hand/ours_paper_seed1_6000.json"
    path.write_text(path.read_text()[:-50])
    for options in (["--page"], ["--list"]):
        status, out, err = run(*options)
        assert (status, out) == (1, "") and err.startswith("store/one_hand/ours_paper_seed1_6000.json: not whole JSON")
        assert err.count("\n") == 1


def test_a_store_that_is_not_there(made):
    """A missing or empty store is an error, so that no empty page replaces an existing one."""
    for options in (["--page"], ["--list"]):
        status, out, err = run("--ledger", "lodger", *options)
        assert (status, out) == (1, "") and err.startswith("lodger: no such folder") and err.count("\n") == 1
    (made / "empty").mkdir()
    status, out, err = run("--ledger", "empty", "--page")
    assert (status, out) == (1, "") and err.startswith("empty: no results yet") and err.count("\n") == 1
    (made / "file").write_text("")
    assert run("--ledger", "file", "--hours", "0")[0] == 1
    assert not (made / "results").exists()


def test_a_seed_named_twice(made):
    """A repeated option counts once."""
    out = run("--list", "--seeds", "2", "2", "--networks", "ours", "ours", "--recipe", "adam", "--setting", "one_hand")[
        1
    ]
    assert out.count("ours, adam, seed 2") == 1


def test_without_nyu_a_line_says_how_to_get_it(made):
    """Without NYU an error names the command that prepares it."""
    status, _, err = run("--setting", "nyu")
    cost, error = err.splitlines()
    assert status == 1 and error.startswith("data/nyu/train.txt: cannot read the list of HDF5 files")
    assert "tools/prepare_nyu.py NYU_ROOT" in error and cost.endswith(" training runs are missing: an unknown time")


def test_other_frames_are_not_nyu(made, small_data):
    """With synthetic hands in place of NYU nothing is fitted, trained or scored."""
    (made / "data/nyu").mkdir(parents=True)
    for split in ("train", "test"):
        (made / f"data/nyu/{split}.txt").write_text(f"{small_data}/{split}_000.h5\n")
    status, _, err = run("--setting", "nyu")
    assert status == 1 and err.splitlines()[-1] == (
        "data/nyu: holds frames that prepare_nyu did not make; expected the NYU data set, or --setting one_hand"
    )
    assert not (made / "data/nyu_angles").exists() and not (made / "work").exists()


def test_folders_that_cannot_be_made(setting, narrow, tmp_path):
    """A folder that cannot be created raises an error."""
    (tmp_path / "work").write_text("")
    with pytest.raises(netlib.NetlibError, match="cannot make the folder: "):
        sit(tmp_path, [Job(setting, narrow["ours"], RECIPES["paper"], 1)])


@pytest.mark.parametrize(
    "options",
    [
        ["--longest", "0"],
        ["--longest", "3999"],
        ["--longest", "19999", "--recipe", "adam"],
        ["--seeds", "-1"],
        ["--networks", "other"],
        ["--list", "--page"],
        ["--list", "--setting", "one_hand", "--networks", "ours_scale", "ours_bones"],
        ["--list", "--recipe", "paper", "--networks", "ours_scale"],
    ],
)
def test_usage(options):
    """Wrong usage gives argparse's message and status 2."""
    run(*options, status=2)
