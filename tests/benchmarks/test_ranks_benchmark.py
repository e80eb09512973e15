"""benchmarks/ranks.py: steps of one process and of ranks, and the model of many machines."""

from __future__ import annotations

import pytest

from benchmarks import ranks
from tests.support.ranks_started import needs_mpi
from tests.support.running import run_tool


@needs_mpi
def test_a_benchmark(monkeypatch: pytest.MonkeyPatch) -> None:
    """The table has one process and two ranks on a machine with one processor, and a row per network of the model."""
    monkeypatch.setattr(ranks.engine, "available_cpus", lambda: 1)
    lines = run_tool("benchmarks.ranks", "--steps", "1", "--batch", "2").out.splitlines()
    assert lines[1].startswith("batch 2, gradients 9.1 MB")
    assert [line[:5] for line in lines[3:5]] == ["1 x 1", "2 x 1"]
    assert [line.split("  ")[0] for line in lines[-3:]] == [network.name for network in ranks.NETWORKS]


def test_the_model() -> None:
    """A network without latency and of infinite speed costs the copies and rank 0's work; a slower one costs more."""
    alone = ranks.Step(whole=0.1, behind=0.05, agree=0.0, average=0.0)
    free = ranks.Network("free", 0.0, float("inf"))
    assert ranks.model(free, 2, alone, 0.01, 9_000_000) == pytest.approx(0.11 + 2e-6)
    times = [ranks.model(network, 16, alone, 0.01, 9_000_000) for network in ranks.NETWORKS]
    assert times == sorted(times, reverse=True)


@pytest.mark.parametrize("options", [["--steps", "0"], ["--batch", "none"]], ids=" ".join)
def test_usage(options: list[str]) -> None:
    """Wrong usage gives argparse's message, which names the option, and status 2."""
    assert options[0] in run_tool("benchmarks.ranks", *options, status=2).err.splitlines()[-1]
