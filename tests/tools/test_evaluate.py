"""tools/evaluate.py: tables, JSON and plots of published predictions."""

import re
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from handpose.frames.cameras import ICVL
from handpose.scoring import published_predictions
from handpose.scoring.published_predictions import FittedAngles
from tests.support.running import run_tool
from tests.tools.conftest import mistakes_of
from tools import evaluate

FRAMES = 20


@pytest.fixture
def files(here, rng):
    """Annotations of 20 ICVL frames, the same moved by 3 mm and by 30 mm along z, and the latter
    also as x y z.
    """
    truth = rng.normal((0, 0, 400), 30, (FRAMES, 16, 3))
    for name, move in (("truth", 0), ("near", 3), ("far", 30)):
        np.savetxt(
            f"{name}.txt", ICVL.project(truth + (0, 0, move)).reshape(FRAMES, 48), fmt="%.6f"
        )
    np.savetxt("far_xyz.txt", (truth + (0, 0, 30)).reshape(FRAMES, 48), fmt="%.6f")
    return here


def run(*arguments, dataset="icvl", status=0):
    command = f"evaluate {dataset} --groundtruth truth.txt --predictions"
    return run_tool(command, *arguments, status=status)


def test_tables(files):
    """The table states the data, then has one line per method and one line per joint."""
    out = run("Near=near.txt", "--predictions", "Far hand=far.txt").out.splitlines()
    assert out[0] == (
        "ICVL, 20 frames of the test set's 1596, 16 joints: errors in mm between absolute positions in camera axes;"
    )
    assert " ".join(out[3].split()) == (
        "method mean median of max max <= 20 mm max <= 40 mm max <= 60 mm max <= 80 mm"
    )
    assert out[4].split() == ["Near", "3.00", "3.00", "100.0%", "100.0%", "100.0%", "100.0%"]
    assert out[5].split() == ["Far", "hand", "30.00", "30.00", "0.0%", "100.0%", "100.0%", "100.0%"]
    assert out[9].split() == ["joint", "Near", "Far", "hand"]
    assert [line.split() for line in out[10:]][::16] == [
        ["palm", "3.00", "30.00"],
        ["mean", "3.00", "30.00"],
    ]


def test_formats(files):
    assert run("Far=far.txt").out == run("Far=far_xyz.txt", "--format", "xyz").out
    done = run("A=far.txt", "--groundtruth", "far_xyz.txt", "--groundtruth-format", "xyz")
    assert done.out.splitlines()[4].split()[:2] == ["A", "0.00"]


def test_wrong_format_is_noticed(files):
    err = run("Far=far_xyz.txt").err
    assert err.startswith("warning: far_xyz.txt: the mean error is ")
    assert err.count("\n") == 1
    assert err.endswith("y up if xyz, and that the frames are those of ICVL\n")


def test_pictures(files):
    """Plots are written in each format, with more methods than colours, and names are not typeset
    by matplotlib.
    """
    pytest.importorskip("matplotlib")
    captured = run(*(f"_$n_{i}$=near.txt" for i in range(9)), "--plot", "a.png")
    assert captured.err == "wrote a.png\n"
    assert cv2.imread("a.png").std() > 10
    run("Far=far.txt", "--plot", "b.SVG")
    assert (files / "b.SVG").read_bytes().startswith(b"<?xml")
    assert not list(files.glob(".*.tmp"))


@pytest.fixture
def hands2017(here, rng):
    """Labels of 20 frames as HANDS 2017 writes them, and predictions 3 mm lower in another order
    and with folders.
    """
    camera = published_predictions.HANDS2017
    truth = rng.normal((0, 50, 400), 30, (FRAMES, 21, 3))

    def lines(joints, folder=""):
        rows = joints.reshape(FRAMES, 63)
        return [
            f"{folder}image_D{n:08}.png\t" + "\t".join(f"{x:.4f}" for x in row)
            for n, row in enumerate(rows, 1)
        ]

    down = truth * (1, -1, 1)
    Path("truth.txt").write_text("\n".join(lines(down)) + "\n")
    Path("low.txt").write_text("\n".join(reversed(lines(down + (0, 3, 0), "frame/images/"))))
    np.savetxt("uvd.txt", camera.project(truth - (0, 3, 0)).reshape(FRAMES, 63), fmt="%.6f")
    return here


def test_labels_of_hands_2017(hands2017):
    """Frames are matched by the names of their images; y is down in x y z, and v grows
    downwards in u v d.
    """
    out = run("Low=low.txt", dataset="hands2017").out.splitlines()
    assert out[0].startswith(
        "HANDS 2017, 20 frames of the test set's 295510, 21 joints: errors in mm"
    )
    assert out[4].split()[:2] == ["Low", "3.00"]
    assert [line.split()[0] for line in out[9:16]] == [
        "wrist",
        "thumb_mcp",
        "index_mcp",
        "middle_mcp",
        "ring_mcp",
        "little_mcp",
        "thumb_pip",
    ]
    assert out[-2].split() == ["little_tip", "3.00"]
    same = run("Low=uvd.txt", "--format", "uvd", dataset="hands2017").out.splitlines()
    assert same[4].split()[:2] == ["Low", "3.00"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda lines: lines[1:],
            "low.txt: has no image_D00000020.png, which the ground truth has (1 such images)",
        ),
        (lambda lines: [*lines, lines[0]], "low.txt: has image_D00000020.png twice"),
        (
            lambda lines: [lines[0], lines[1].partition("\t")[2]],
            "low.txt:2: no name of an image, as the lines before",
        ),
        (
            lambda lines: [lines[0] + "\t1"],
            "low.txt:1: found 64 numbers, expected 63 = 21 joints x 3",
        ),
        (lambda lines: [lines[0] + "x"], "low.txt:1:"),
    ],
)
def test_labels_that_do_not_match_are_rejected(hands2017, change, message):
    lines = change(Path("low.txt").read_text().split("\n"))
    Path("low.txt").write_text("\n".join(lines))
    assert run("Low=low.txt", dataset="hands2017", status=1).err.startswith(message)


@mistakes_of("evaluate")
def test_mistakes(files, argv, message):
    """A file that cannot be used gives one line on stderr and nothing on stdout."""
    pytest.importorskip("matplotlib")
    near = (files / "near.txt").read_text()
    (files / "near.png").write_text(near)
    (files / "short.txt").write_text("".join(near.splitlines(keepends=True)[:-1]))
    assert run(*argv.split(), status=1)[1:] == ("", f"{message}\n")
    assert (files / "near.png").read_text() == near
    assert not list(files.glob(".*.tmp"))


def test_without_matplotlib(files, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert (
        run("A=near.txt", "--plot", "a.png", status=1).err
        == "matplotlib is missing: pip install matplotlib\n"
    )
    run("A=near.txt")


def test_angles(here, monkeypatch):
    """--angles adds a table of the angles of each method; predictions may not be of the model."""
    monkeypatch.setattr(
        evaluate.published,
        "compare_angles",
        lambda skeleton, truth, predictions, watch: {
            "Bent": FittedAngles(9.126, 0.5, 0.001, 0.5),
            "Noise": FittedAngles(20, 6.25, 4, None),
        },
    )
    np.savetxt("truth.txt", np.tile([320.0, 240, 700], (2, 14)))
    methods = ["Bent=truth.txt", "Noise=truth.txt", "--angles"]
    lines = run(*methods, dataset="nyu").out.splitlines()[-3:]
    heads, *rows = [re.split(r"\s{2,}", line) for line in lines]
    assert heads == [
        "method",
        "angle error",
        "residual within limits",
        "without limits",
        "frames out of limits",
    ]
    assert rows == [
        ["Bent", "9.13 deg", "0.500 mm", "0.0010 mm", "50.00%"],
        ["Noise", "20.00 deg", "6.250 mm", "4.0000 mm", "not of this model"],
    ]
