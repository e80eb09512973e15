"""tools/measure_finding.py: the fraction of scenes in which the hand is found."""

import json

from handpose.estimate.locator import Locator
from netlib.errors import DataError
from tests.support.running import run_tool


def test_a_table():
    """The table has a row for each kind of scene and one for all; most hands are found."""
    first, names, *rows = run_tool("measure_finding", "--scenes", "3", "--seed", "3", "--fit", "fast").out.splitlines()
    assert first.startswith("3 scenes, seed 3, fast fit, ")
    assert names.split() == ["scenes", "count", "found", "right", "located", "mean", "median"]
    assert [row.split()[:2] for row in rows] == [["forearm", "1"], ["body", "1"], ["clutter", "1"], ["all", "3"]]
    assert float(rows[-1].split()[2].rstrip("%")) > 60


def test_where_nothing_is_found(monkeypatch):
    """A scene without a detection counts as not found and has no error."""

    def nothing(self, depth, camera):
        raise DataError("what may be a hand is out of sight")

    monkeypatch.setattr(Locator, "hands", nothing)
    said = json.loads(run_tool("measure_finding", "--scenes", "1", "--json").out)
    (forearm, every) = said["rows"]
    assert said["ms"] > 0 and forearm | {"scenes": "all"} == every
    assert (every["count"], every["found"], every["right"], every["mean"], every["located"]) == (1, 0, 0, None, None)


def test_json():
    """JSON has the same rows."""
    report = json.loads(run_tool("measure_finding", "--scenes", "2", "--fit", "fast", "--json").out)
    assert [row["scenes"] for row in report["rows"]] == ["forearm", "body", "all"]
    assert all(0 <= row["found"] <= 1 and row["mean"] > 0 for row in report["rows"]) and report["ms"] > 0
