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
from netlib.files.locks import Lock
lock = Lock(Path(sys.argv[1]))
print(lock.taken, lock.holder, flush=True)
sys.stdin.read()
"""


def test_one_at_a_time(tmp_path: Path) -> None:
    """A second lock on the same path fails, also in one process, and names the holder; release
    removes the file.
    """
    path = tmp_path / ".prefix.lock"
    first = locks.Lock(path)
    second = locks.Lock(path)
    assert (first.taken, second.taken, second.holder) == (True, False, str(os.getpid()))
    second.release()
    assert path.exists()
    first.release()
    assert not path.exists()
    third = locks.Lock(path)
    assert third.taken
    third.release()


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
        assert holder.stdout.readline() == b"True \n"
        assert locks.Lock(path).holder == str(holder.pid)
        holder.send_signal(signal.SIGKILL)
        holder.communicate()
    mine = locks.Lock(path)
    assert mine.taken
    mine.release()


def test_a_planted_link(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    (tmp_path / ".lock").symlink_to(tmp_path / "precious")
    with pytest.raises(OSError, match=r"Too many levels of symbolic links: '.*\.lock'$"):
        locks.Lock(tmp_path / ".lock")
    assert (tmp_path / "precious").read_text() == "mine"


def test_a_system_without_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "fcntl", None)
    both = [locks.Lock(tmp_path / ".lock") for _ in range(2)]
    assert [lock.taken for lock in both] == [True, True]
    for lock in both:
        lock.release()
    assert not (tmp_path / ".lock").exists()
