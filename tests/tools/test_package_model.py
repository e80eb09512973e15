"""tools/package_model.py and tools/measure_fit.py: a compressed file of weights and its errors."""

import hashlib
import json

import numpy as np
import pytest

import netlib
from handpose.estimate.packaged import HAND_LOCATOR, SYNTHETIC_HAND, read_card, rounded
from handpose.fit.body import CapsuleModel
from handpose.fit.network_errors import read_errors
from layers.hand import skeleton
from tests.support.running import run_tool

DEPLOY = str(SYNTHETIC_HAND / "deploy.prototxt")


def test_packaging(tmp_path, monkeypatch):
    """The packaged file is smaller, can be loaded, and has error tables for both plans; its checksum is printed."""
    monkeypatch.chdir(tmp_path)
    netlib.Net(DEPLOY, read_card(SYNTHETIC_HAND).weights, netlib.TEST).save("big.caffemodel.h5")
    arguments = ["big.caffemodel.h5", "--model", DEPLOY, "--out", "small.caffemodel.h5", "--bits", "6"]
    out = run_tool("package_model", *arguments, "--frames", "21").out
    assert "21 frames of the recipe people: network " in out and "with 6 bits " in out
    small = (tmp_path / "small.caffemodel.h5").read_bytes()
    assert hashlib.sha256(small).hexdigest() in out
    assert len(small) < 0.5 * (tmp_path / "big.caffemodel.h5").stat().st_size
    errors = read_errors("small.caffemodel.h5", CapsuleModel(skeleton.load(), 150.0))
    assert set(errors.tables) == {"fast", "accurate"} and len(errors.limbs) == 20
    assert errors.poses is not None and errors.poses.mean.shape == (20,)
    own = ["--weights", "small.caffemodel.h5", "--model", DEPLOY]
    run_tool("measure_fit", *own, "--frames", "1", "--recipes", "nyu")


def test_a_net_without_a_hand(tmp_path):
    """The weights of a net without a hand are rounded and compressed only."""
    net = netlib.Net(HAND_LOCATOR / "deploy.prototxt", netlib.TEST, seed=1)
    net.save(tmp_path / "big.caffemodel.h5")
    deploy, out = str(HAND_LOCATOR / "deploy.prototxt"), tmp_path / "small.caffemodel.h5"
    done = run_tool("package_model", tmp_path / "big.caffemodel.h5", "--model", deploy, "--out", out)
    assert done.out.startswith(f"wrote {out}: 0.")
    again = netlib.Net(deploy, out, netlib.TEST)
    for name, blobs in net.params.items():
        np.testing.assert_array_equal(again.params[name][0].data, rounded(blobs[0].data, 10))


def test_figures_as_json():
    """JSON has the network and each plan, in total and for each range of the roll angle."""
    arguments = ["--frames", "20", "--recipes", "any_roll", "--plans", "fast", "--hands", "--roll", "--json"]
    report = json.loads(run_tool("measure_fit", *arguments).out)
    network, fast = report["rows"][:2]
    assert (network["plan"], fast["plan"], fast["frames"]) == ("network", "fast", 20)
    assert fast["median"] < network["median"] and 0 <= fast["right"] <= 1
    assert sum(row["frames"] for row in report["rows"][2:] if row["plan"] == "fast") == 20


def test_terms():
    """--terms prints a line for each term that is left out."""
    lines = run_tool("measure_fit", "--frames", "2", "--recipes", "nyu", "--plans", "fast", "--terms").out.splitlines()
    assert lines[0].startswith("2 frames per recipe, seed 0")
    assert [line for line in lines if " silhouette " in line] and [line for line in lines if " thickness " in line]


@pytest.mark.parametrize(
    ("tool", "arguments", "message"),
    [
        (
            "package_model",
            ["a", "--model", "b", "--out", "c", "--bits", "24"],
            "--bits: expected an integer of at most 23",
        ),
        ("package_model", ["--seed", "4294967296"], "--seed: expected an integer of at most 4294967295"),
        ("measure_fit", ["--seed", "4294967296"], "--seed: expected an integer of at most 4294967295"),
        ("measure_fit", ["--weights", "a"], "--weights and --model must be given together"),
    ],
)
def test_usage(tool, arguments, message):
    """Wrong usage gives exit status 2."""
    assert message in run_tool(tool, *arguments, status=2).err


def test_no_folder(tmp_path):
    """A missing folder is reported before the work."""
    out = tmp_path / "nowhere" / "x.h5"
    done = run_tool("package_model", "a.h5", "--model", DEPLOY, "--out", out, status=1)
    assert f"{out}: folder {out.parent} does not exist" in done.err


@pytest.mark.parametrize("place", ["", ".", "/"])
def test_a_place_that_is_a_folder(tmp_path, monkeypatch, place):
    """A folder as the output is reported before the work."""
    monkeypatch.chdir(tmp_path)
    done = run_tool("package_model", "a.h5", "--model", DEPLOY, "--out", place, status=1)
    assert done.err == f"{place or '.'}: Is a directory\n"


@pytest.mark.parametrize("frames", ["1", "4", "16", "20"])
def test_too_few_frames(tmp_path, frames):
    """Too few frames for an invertible covariance raise an error with the required number."""
    weights, out = str(read_card(SYNTHETIC_HAND).weights), str(tmp_path / "x.h5")
    assert run_tool("package_model", weights, "--model", DEPLOY, "--out", out, "--frames", frames, status=1).err == (
        f"--frames {frames} is too few for the covariance of 20 inputs; expected --frames 21 or more\n"
    )
    assert list(tmp_path.iterdir()) == []
