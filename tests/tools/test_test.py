"""tools/test.py: errors in mm, a table, JSON and a picture."""

import json

import cv2
import h5py
import numpy as np
import pytest

import netlib
from handpose.estimate.packaged import SYNTHETIC_HAND, read_card
from netlib import engine
from tests.support.hdf5_files import write_hdf5
from tests.support.running import run_tool
from tests.tools.conftest import ROOT
from tools import test


@pytest.fixture
def snapshot(work):
    run_tool("train solver.prototxt --max-iter 1")
    return "snapshots/net_iter_1.caffemodel"


def test_figures_of_each_snapshot(work, snapshot):
    """The report has them in JSON; tests of handpose/scoring/held_out.py check their values."""
    report = json.loads(run_tool("test --model net.prototxt", snapshot, snapshot, "--json").out)
    first, second = report["snapshots"]
    assert report["frames"] == 24 and report["data"] == "synthetic"
    assert first == second and first.keys() >= {"error_mm", "joint_loss"}


def test_table_and_picture(work, snapshot):
    """The table has a line for each snapshot; the picture shows frames with both skeletons."""
    lines = run_tool(
        "test --model net.prototxt", snapshot, "--picture", "pictures/hands.png"
    ).out.splitlines()
    assert lines[0].startswith("24 frames (synthetic), errors about the crop's centre, cube 300 mm")
    assert "14 joints mm" in lines[1] and lines[2].startswith(snapshot)
    assert cv2.imread("pictures/hands.png").shape[2] == 3


def test_engine(work, snapshot, monkeypatch):
    """--engine selects the engine; the errors agree to rounding."""
    names, nets, found = ["plain"] + (["fast"] if engine.has_fast() else []), [], []
    monkeypatch.setattr(
        test, "Net", lambda *args, **options: nets.append(netlib.Net(*args, **options)) or nets[-1]
    )
    for name in names:
        done = run_tool("test --model net.prototxt", snapshot, "--json", "--engine", name)
        found.append(json.loads(done.out)["snapshots"][0]["error_mm"])
    assert [net.engine.name for net in nets] == names
    assert found == pytest.approx(found[:1] * len(found), rel=1e-5)


def test_mistakes(work, snapshot):
    done = run_tool("test --model net.prototxt nothing.h5", status=1)
    assert done.err == "nothing.h5: cannot read weights: No such file or directory\n"
    write_hdf5("other.h5", **{"data/other/0": np.zeros(3)})
    done = run_tool("test --model net.prototxt other.h5", status=1)
    assert "it has no layer of net 'DeepModel'" in done.err
    narrow = (work / "net.prototxt").read_text().replace("num_output: 64", "num_output: 48")
    (work / "narrow.prototxt").write_text(narrow)
    done = run_tool("test --model narrow.prototxt", snapshot, status=1)
    assert done.err.splitlines()[-1].endswith(
        "; the net is narrow.prototxt: give that of these weights with --model"
    )


def test_predictions_that_are_all_equal(work, snapshot):
    """A net whose predictions are all equal is reported as such; a net with large errors is not."""
    net = netlib.Net("net.prototxt", snapshot, netlib.TEST)
    assert "predictions are equal" not in run_tool("test --model net.prototxt", snapshot).err
    for blob in net.params["FC1"]:
        blob.data[...] = 0
    net.save("dead.caffemodel")
    done = run_tool("test --model net.prototxt dead.caffemodel")
    assert (
        "warning: dead.caffemodel: all 24 predictions are equal, whatever the frame shows: are units of"
        in done.err
    )


def test_fit(work, small_data):
    """--fit adds the errors after the fit to the depth, and the picture shows the fitted hands."""
    model = (
        (SYNTHETIC_HAND / "train_test.prototxt").read_text().replace("data/people", str(small_data))
    )
    model = model.replace("../../prototxt", str(ROOT / "prototxt"))
    (work / "own.prototxt").write_text(model.replace("batch_size: 250", "batch_size: 10"))
    weights = str(read_card(SYNTHETIC_HAND).weights)
    deploy = str(SYNTHETIC_HAND / "deploy.prototxt")
    arguments = ["--model", "own.prototxt", "--deploy", deploy, weights, "--fit", "fast"]
    (row,) = json.loads(run_tool("test", *arguments, "--json").out)["snapshots"]
    assert row["fit_error_14_mm"] < 0.7 * row["error_14_mm"]
    assert row["fit_within_40_mm"] >= row["within_40_mm"]
    assert "fit_out_of_limits" not in row
    done = run_tool("test", *arguments, "--picture", "x.png")
    assert "fit: all joints mm" in done.out and cv2.imread("x.png") is not None


def test_frames_that_cannot_be_fitted(work, small_data, snapshot):
    """Frames without crop centres, or of several cameras, cannot be fitted."""
    (work / "data").mkdir()
    with h5py.File(small_data / "test_000.h5") as file:
        arrays = {
            name: file[name][...]
            for name in ("depth", "joint", "half_cube", "center", "center_uvd")
        }
    net = (work / "net.prototxt").read_text().replace(str(small_data), "data")
    (work / "own.prototxt").write_text(net)
    deploy = (
        (ROOT / "prototxt" / "nyu_deploy.prototxt")
        .read_text()
        .replace("num_output: 1024", "num_output: 64")
    )
    (work / "deploy.prototxt").write_text(deploy)
    options = ["--model", "own.prototxt", "--deploy", "deploy.prototxt", snapshot, "--fit", "fast"]
    (work / "data" / "test.txt").write_text(str(work / "data" / "test.h5"))
    for missing, change, message in (
        ("center", {}, "no data set 'center'; it has "),
        (
            "",
            {"center_uvd": arrays["center_uvd"] + np.arange(24)[:, None]},
            "fit none of the cameras nyu, ",
        ),
        ("", {"center_uvd": arrays["center_uvd"][:, :2]}, "centres of shape"),
    ):
        write_hdf5(
            work / "data" / "test.h5",
            **{n: v for n, v in (arrays | change).items() if n != missing},
        )
        assert message in run_tool("test", *options, status=1).err
