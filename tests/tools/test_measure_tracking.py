"""tools/measure_tracking.py: a row for each hand, and one for all."""

import json

import pytest

from tools import measure_tracking

SHORT = ["--cameras", "icvl", "--seconds", "0.3", "--rate", "10"]


def test_a_table(capsys):
    """Both hands of one recording and the only one of the other; columns without figures are left out."""
    assert measure_tracking.main(["--scripts", "rest", "left", "--seeds", "3", *SHORT]) == 0
    first, names, *rows = capsys.readouterr().out.splitlines()
    assert first == "6 frames, 10 a second, fast fit, smoothed; mm, lag in ms"
    assert names.split()[:6] == ["script", "camera", "seed", "hand", "in", "sight"]
    assert "missed" in names and "frames/s" in names and "alone" not in names and "lag" not in names
    assert [row.split()[:5] for row in rows[:2]] == [
        ["rest", "icvl", "3", "0", "right"],
        ["left", "icvl", "3", "0", "left"],
    ]
    assert rows[2].split()[:2] == ["all", "6"] and len(rows) == 3


def test_json(capsys):
    """The same figures, and those of frames alone; what nothing is known of is null."""
    argv = ["--scripts", "rest", "--seeds", "3", "--raw", "--frame-by-frame", "2", "--json", *SHORT]
    assert measure_tracking.main(argv) == 0
    report = json.loads(capsys.readouterr().out)
    hand, total = report["rows"]
    assert (report["frames"], report["smoothed"], report["hz"]) == (3, False, 10)
    assert hand["hand"] == "0 right" and hand["in_sight"] == 3 and hand["alone_found"] == 1
    assert hand["alone"] > 0 and hand["lag"] is None
    assert {**total, "script": "rest", "camera": "icvl", "seed": "3", "hand": "0 right"} == hand


def test_a_rate_that_no_camera_has(capsys):
    """Is wrong usage: the run would not end."""
    with pytest.raises(SystemExit, match="2"):
        measure_tracking.main(["--scripts", "rest", "--rate", "1e300"])
    assert "argument --rate: expected a number of more than 0 and at most" in capsys.readouterr().err
