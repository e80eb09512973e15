"""Ranks over MPI: rank_programs.py runs its checks in real processes."""

import re

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


def test_a_network_that_is_cut(tmp_path, monkeypatch):
    """A rank that stops waiting for a missing rank ends, even if MPI itself keeps waiting."""
    monkeypatch.chdir(tmp_path)
    done = ranks_started.run(2, PROGRAMS, "cut_off")
    assert done.returncode != 0
    said = r"^no response from rank 1 for \d+ s; all ranks end, the last snapshot is untouched$"
    assert re.search(said, done.stderr, re.MULTILINE)
