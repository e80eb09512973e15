"""benchmarks/bench.py: every comparison runs, with and without the peers, and the JSON has the figures of the table."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import netlib
from benchmarks import bench, stored
from tests.support.running import run_tool

SMALLEST = ["--rounds", "1", "--burst", "1e-9", "--batch", "4", "--threads", "1"]


@pytest.fixture(autouse=True)
def quiet(keep_threads: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine counts as idle, no results are stored, and the number of threads is restored afterwards."""
    monkeypatch.setattr(bench.os, "getloadavg", lambda: (0.0, 0.0, 0.0))
    monkeypatch.setattr(stored, "RESULTS", tmp_path / "results")


@pytest.mark.parametrize("alone", [True, False], ids=["alone", "with the peers"])
def test_a_benchmark(alone: bool, tmp_path: Path) -> None:
    """The table has a row for every figure, and --json writes the same figures."""
    if bench.MISSING and not alone:
        pytest.skip(f"the peers need {bench.MISSING}: pip install -e '.[bench]'")
    file = tmp_path / "speed.json"
    _, out, err = run_tool("benchmarks.bench", *SMALLEST, "--json", file, *(["--alone"] if alone else []))
    assert err == ""
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    assert list(dict.fromkeys(row["what"] for row in rows)) == [
        "training step, batch 4",
        "training step, batch 2",
        "forward, batch 4",
        "forward, batch 2",
        "one image with the hand, 1 thread",
        "one image without the hand, 1 thread",
        "HandModel forward + backward, 4",
        "sgemm peak",
        "fraction of peak, training",
        "fraction of peak, forward",
        "time of 4 against 2 x 2",
        "data, log and overhead",
        "peak memory, training at 4",
    ]
    lines = out.splitlines()[1 : 1 + len(rows)]
    assert [row["what"] for row in rows] == [line[:38].rstrip() for line in lines]
    assert alone == (not stored.RESULTS.exists())  # the stored values are ratios
    assert alone == (not any("peer" in row for row in rows))
    assert all(value > 0 for row in rows for key in ("value", "netlib_ms", "peer_ms", "ratio")
               if (value := row.get(key)) is not None and row["what"] != "data, log and overhead")


FACTS = {"kind": "a processor; 2 threads; BLAS", "date": "2026-01-02"}
ROW = {"what": "training step", "peer": "PyTorch", "ratio": 2.0, "noise": 0.01, "netlib_ms": 1.0, "peer_ms": 2.0}


def test_what_is_slower_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    """Ratios are compared with the first stored ones, until others replace them; only --check makes a status of it."""
    slow = {**ROW, "ratio": 1.5}
    assert bench.compare_with_stored(FACTS, [ROW, {"what": "sgemm peak", "value": 3.0}]) == 0
    assert bench.compare_with_stored(FACTS, [{**ROW, "ratio": 1.95}], check=True) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("nothing is slower than on 2026-01-02")
    for check in (False, True):
        assert bench.compare_with_stored(FACTS, [slow], check=check) == check
        assert "training step, against PyTorch: 1.50x, was 2.00x (noise 3%)" in capsys.readouterr().out
    assert bench.compare_with_stored(FACTS, [{**slow, "noise": 0.4}], check=True) == 0
    assert bench.compare_with_stored({**FACTS, "kind": "another"}, [slow]) == 0
    assert bench.compare_with_stored(FACTS, [slow], store=True) == 0
    assert bench.compare_with_stored(FACTS, [slow], check=True) == 0


@pytest.mark.parametrize("content", ["", "[]", '{"rows": [{"what": "step"}]}', '{"rows": []}'])
def test_a_damaged_store(content: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A damaged store is kept, and reported in one line: as an error with --check only."""
    path = stored.path_of(FACTS["kind"])
    path.parent.mkdir()
    path.write_text(content, encoding="utf-8")
    with pytest.raises(netlib.DataError, match=path.name):
        bench.compare_with_stored(FACTS, [ROW], check=True)
    assert bench.compare_with_stored(FACTS, [ROW]) == 0
    assert path.name in capsys.readouterr().err
    assert path.read_text(encoding="utf-8") == content


def test_a_store_that_cannot_be_written(capsys: pytest.CaptureFixture[str]) -> None:
    """Without a folder for results, --store fails; a run without it prints a note."""
    stored.RESULTS.write_text("a file")
    with pytest.raises(OSError, match="results"):
        bench.compare_with_stored(FACTS, [ROW], store=True)
    assert bench.compare_with_stored(FACTS, [ROW]) == 0
    assert capsys.readouterr().err.count("\n") == 1


def test_a_missing_peer_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A missing peer is reported in one line with the remedy."""
    monkeypatch.setattr(bench, "MISSING", "torch")
    done = run_tool("benchmarks.bench", *SMALLEST, status=1)
    error = "torch is missing: pip install -e '.[bench]', or use --alone to time only this project\n"
    assert done[1:] == ("", error)


def test_nothing_to_check_against(monkeypatch: pytest.MonkeyPatch) -> None:
    """--check without stored ratios fails before anything is timed."""
    monkeypatch.setattr(bench, "MISSING", None)
    assert "run without --check first" in run_tool("benchmarks.bench", *SMALLEST, "--check", status=1).err


@pytest.mark.parametrize(
    "options", [["--rounds", "0"], ["--threads", "-1"], ["--burst", "0"], ["--alone", "--check"]], ids=" ".join
)
def test_usage(options: list[str]) -> None:
    """Wrong usage gives argparse's message, which names the option, and status 2."""
    assert options[0] in run_tool("benchmarks.bench", *options, status=2).err.splitlines()[-1]
