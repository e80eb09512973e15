"""benchmarks/bench.py: every comparison runs, with and without the peers, and the JSON has the figures of the table."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import netlib
from benchmarks import bench, stored
from tests.support.running import run_tool

SMALLEST = ["--rounds", "1", "--burst", "1e-9", "--batch", "16"]


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
        "training step, batch 16",
        "training step, batch 2",
        "forward, batch 16",
        "forward, batch 2",
        "one image with the hand, 1 thread",
        "one image without the hand, 1 thread",
        "HandModel forward + backward, 16",
        "sgemm peak",
        "fraction of peak, training",
        "fraction of peak, forward",
        "time of 16 against 8 x 2",
        "data, log and overhead",
        "peak memory, training at 16",
    ]
    lines = out.splitlines()[1 : 1 + len(rows)]
    assert [row["what"] for row in rows] == [line[:38].rstrip() for line in lines]
    assert alone == (not stored.RESULTS.exists())  # the stored values are ratios
    assert alone == (not any("peer" in row for row in rows))
    assert all(value > 0 for row in rows for key in ("value", "netlib_ms", "peer_ms", "ratio")
               if (value := row.get(key)) is not None and row["what"] != "data, log and overhead")  # fmt: skip


def test_what_is_slower_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    """Ratios are compared with the first stored ones, until others replace them, and slower parts are named."""
    facts = {"kind": "a processor; 2 threads; BLAS", "date": "2026-01-02"}
    row = {"what": "training step", "peer": "PyTorch", "ratio": 2.0, "noise": 0.01, "netlib_ms": 1.0, "peer_ms": 2.0}
    slow = {**row, "ratio": 1.5}
    assert bench.compare_with_stored(facts, [row, {"what": "sgemm peak", "value": 3.0}], store=False) == 0
    assert bench.compare_with_stored(facts, [{**row, "ratio": 1.95}], store=False) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("nothing is slower than on 2026-01-02")
    assert bench.compare_with_stored(facts, [slow], store=False) == 1
    assert "training step, against PyTorch: 1.50x, was 2.00x (noise 3%)" in capsys.readouterr().out
    assert bench.compare_with_stored(facts, [{**slow, "noise": 0.4}], store=False) == 0
    assert bench.compare_with_stored({**facts, "kind": "another"}, [slow], store=False) == 0
    assert bench.compare_with_stored(facts, [slow], store=True) == 0
    assert bench.compare_with_stored(facts, [slow], store=False) == 0


def test_a_damaged_store_is_one_line() -> None:
    """A damaged store is reported in one line and kept."""
    path = stored.path_of("a kind")
    path.parent.mkdir()
    for content in ("", "[]", '{"rows": [{"what": "step"}]}'):
        path.write_text(content, encoding="utf-8")
        with pytest.raises(netlib.DataError, match=r"a_kind\.json"):
            stored.load(path)


def test_a_missing_peer_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A missing peer is reported in one line with the remedy."""
    monkeypatch.setattr(bench, "MISSING", "torch")
    done = run_tool("benchmarks.bench", *SMALLEST, status=1)
    error = "torch is missing: pip install -e '.[bench]', or use --alone to time only this project\n"
    assert done[1:] == ("", error)


@pytest.mark.parametrize("options", [["--rounds", "0"], ["--threads", "-1"], ["--burst", "0"]], ids=" ".join)
def test_usage(options: list[str]) -> None:
    """Wrong usage gives argparse's message, which names the option, and status 2."""
    assert options[0] in run_tool("benchmarks.bench", *options, status=2).err.splitlines()[-1]
