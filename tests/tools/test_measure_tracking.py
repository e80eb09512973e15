"""tools/measure_tracking.py: a row for each hand and one for all."""

import json

from tests.support.running import run_tool

SHORT = ["--cameras", "icvl", "--seconds", "0.3", "--rate", "10"]


def test_a_table():
    """The table has a row for each hand of both recordings; columns without values are omitted."""
    done = run_tool("measure_tracking", "--scripts", "rest", "left", "--seeds", "3", *SHORT)
    first, names, *rows = done.out.splitlines()
    assert first == "6 frames, 10 per second, fast fit, smoothed; mm, lag in ms"
    assert names.split()[:6] == ["script", "camera", "seed", "hand", "in", "sight"]
    assert "missed" in names and "frames/s" in names and "alone" not in names and "lag" not in names
    assert [row.split()[:5] for row in rows[:2]] == [
        ["rest", "icvl", "3", "0", "right"],
        ["left", "icvl", "3", "0", "left"],
    ]
    assert rows[2].split()[:2] == ["all", "6"] and len(rows) == 3


def test_json():
    """JSON has the same values and those of single frames; unknown values are null."""
    argv = ["--scripts", "rest", "--seeds", "3", "--raw", "--frame-by-frame", "2", "--json", *SHORT]
    report = json.loads(run_tool("measure_tracking", *argv).out)
    hand, total = report["rows"]
    assert (report["frames"], report["smoothed"], report["hz"]) == (3, False, 10)
    assert hand["hand"] == "0 right" and hand["in_sight"] == 3 and hand["alone_found"] == 1
    assert hand["alone"] > 0 and hand["lag"] is None
    assert {**total, "script": "rest", "camera": "icvl", "seed": "3", "hand": "0 right"} == hand


def test_a_rate_that_no_camera_has():
    """An excessive rate is a usage error, because the run would not end."""
    done = run_tool("measure_tracking", "--scripts", "rest", "--rate", "1e300", status=2)
    assert "argument --rate: expected a number greater than 0 and at most" in done.err
