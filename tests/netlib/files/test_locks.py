"""netlib/files/locks.py: a lock is held only by a running process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from netlib.files import locks
from netlib.files.paths import ROOT

pytestmark = pytest.mark.skipif(locks.fcntl is None, reason="this system has no such locks")

HOLDER = """
import sys
from pathlib import Path
from netlib.files import locks
with locks.held(Path(sys.argv[1])) as holder:
    print(repr(holder), flush=True)
    sys.stdin.read()
"""


def test_one_at_a_time(tmp_path: Path) -> None:
    """A second lock on the same path fails, also in one process, and names the holder, who
    removes the file.
    """
    path = tmp_path / ".prefix.lock"
    for _ in range(2):
        with locks.held(path) as first:
            with locks.held(path) as second:
                assert (first, second) == ("", str(os.getpid()))
            assert path.exists()
        assert not path.exists()


def test_a_kill_releases(tmp_path: Path) -> None:
    path = tmp_path / ".prefix.lock"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"''\n"
        with locks.held(path) as other:
            assert other == str(holder.pid)
        holder.send_signal(signal.SIGKILL)
        holder.communicate()
    with locks.held(path) as other:
        assert other == ""


def test_a_planted_link(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    (tmp_path / ".lock").symlink_to(tmp_path / "precious")
    too_many = r"Too many levels of symbolic links: '.*\.lock'$"
    with pytest.raises(OSError, match=too_many), locks.held(tmp_path / ".lock"):
        pass
    assert (tmp_path / "precious").read_text() == "mine"


def test_a_system_without_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "fcntl", None)
    with locks.held(tmp_path / ".lock") as one, locks.held(tmp_path / ".lock") as other:
        assert (one, other) == ("", "")
    assert not (tmp_path / ".lock").exists()
