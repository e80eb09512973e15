"""Ranks over MPI: rank_programs.py runs its checks in real processes."""

from tests.support import ranks_started
from tests.support.ranks_started import PROGRAMS, needs_mpi

pytestmark = needs_mpi


def test_four_ranks(tmp_path, monkeypatch):
    """Sums are exact in the order of the ranks, and all ranks agree on requests and errors."""
    monkeypatch.chdir(tmp_path)
    programs = ["sums", "agreement", "errors"]
    done = ranks_started.run(4, PROGRAMS, *programs)
    assert done.returncode == 0, done.stderr
    assert sorted(done.stdout.split("\n")[:-1]) == sorted(f"rank {r} {name}" for name in programs for r in range(4))
