"""tools/test.py: errors in mm as a table, as JSON and in a picture.

tests/handpose/scoring/test_held_out.py checks the values of the figures.
"""

from __future__ import annotations

import json
from pathlib import Path
from unittest.mock import Mock

import cv2
import pytest

import netlib
from handpose.estimate.packaged import SYNTHETIC_HAND, read_card
from tests.support.running import ROOT, Done, refusal, run_tool
from tools import test

SNAPSHOT = "snapshots/net_iter_1.caffemodel"
DEAD = (
    "warning: dead.caffemodel: all 24 predictions are equal, whatever the frame shows: are units of"
)


@pytest.fixture(autouse=True)
def snapshot(work: Path) -> None:
    """The weights after one iteration."""
    run_tool("train solver.prototxt --max-iter 1")


def score(options: str, *weights: str) -> Done:
    return run_tool(f"test --model net.prototxt {options}", *weights)


def test_json_has_the_figures_of_each_snapshot() -> None:
    report = json.loads(score("--json", SNAPSHOT, SNAPSHOT).out)
    first, second = report["snapshots"]
    assert (report["frames"], report["data"]) == (24, "synthetic")
    assert first == second
    assert first.keys() >= {"error_mm", "joint_loss"}


def test_the_table_has_a_line_for_each_snapshot() -> None:
    """The picture shows some frames."""
    title, heads, row = score("--picture pictures/hands.png", SNAPSHOT).out.splitlines()
    assert title == "24 frames (synthetic), errors about the crop's centre, cube 300 mm"
    assert "14 joints mm" in heads
    assert row.startswith(SNAPSHOT)
    assert cv2.imread("pictures/hands.png") is not None


def test_the_engine_is_that_of_the_option(monkeypatch: pytest.MonkeyPatch) -> None:
    net = Mock(wraps=netlib.Net)
    monkeypatch.setattr(test, "Net", net)
    score("--engine plain", SNAPSHOT)
    assert net.call_args.kwargs == {"engine": "plain"}


def test_weights_of_another_net_are_rejected() -> None:
    """The error names the net, whose default may have been meant for other weights."""
    text = Path("net.prototxt").read_text().replace("num_output: 64", "num_output: 48")
    Path("narrow.prototxt").write_text(text)
    line = refusal("test --model narrow.prototxt", SNAPSHOT)
    assert line.endswith("; the net is narrow.prototxt: give that of these weights with --model")


def test_a_net_with_equal_predictions_is_reported() -> None:
    """Unlike one with large errors."""
    net = netlib.Net("net.prototxt", SNAPSHOT, netlib.TEST)
    for blob in net.params["FC1"]:
        blob.data[...] = 0
    net.save("dead.caffemodel")
    assert DEAD in score("", "dead.caffemodel").err
    assert score("", SNAPSHOT).err == ""


def test_errors_after_the_fit_to_the_depth(small_data: Path) -> None:
    """The fitted hands have smaller errors, and the picture shows them."""
    model = (SYNTHETIC_HAND / "train_test.prototxt").read_text()
    for old, new in (
        ("data/people", small_data),
        ("../../prototxt", ROOT / "prototxt"),
        ("batch_size: 250", "batch_size: 10"),
    ):
        model = model.replace(old, str(new))
    Path("own.prototxt").write_text(model)
    command = f"test --model own.prototxt --deploy {SYNTHETIC_HAND}/deploy.prototxt --fit fast"
    weights = read_card(SYNTHETIC_HAND).weights
    (row,) = json.loads(run_tool(f"{command} --json", weights).out)["snapshots"]
    assert row["fit_error_14_mm"] < 0.7 * row["error_14_mm"]
    assert row["fit_within_40_mm"] >= row["within_40_mm"]
    assert "fit_out_of_limits" not in row
    done = run_tool(f"{command} --picture x.png", weights)
    assert "fit: all joints mm" in done.out
    assert cv2.imread("x.png") is not None
