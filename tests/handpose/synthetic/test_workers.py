"""handpose/synthetic/files.py"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from handpose.synthetic.files import no_interrupt, processes

ROOT = Path(__file__).resolve().parents[3]


def test_a_pool_computes() -> None:
    """Jobs run in other processes."""
    with processes(1) as pool:
        assert pool.submit(os.getpid).result() != os.getpid()


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be blocked here")
def test_what_starts_within_does_not_see_ctrl_c() -> None:
    """Processes started within the block inherit the blocked SIGINT; this process is unchanged."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    with processes(1) as pool:
        with no_interrupt():
            blocked = pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ())
        assert signal.SIGINT in blocked.result()
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="waiting for a process that is not a child needs pidfd_open")
def test_workers_do_not_outlive_their_parent(tmp_path: Path) -> None:
    """Workers end when their parent is killed, although it cannot notify them."""
    script = tmp_path / "parent.py"
    script.write_text(
        "import os, sys\n"
        "from handpose.synthetic.files import processes\n"
        "if __name__ == '__main__':\n"
        "    with processes(1) as pool:\n"
        "        print(pool.submit(os.getpid).result(), flush=True)\n"
        "        sys.stdin.read()\n"
    )
    parent = subprocess.Popen(
        [sys.executable, str(script)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    with parent:
        assert parent.stdout is not None
        worker = os.pidfd_open(int(parent.stdout.readline()))
        try:
            parent.kill()
            ended, _, _ = select.select([worker], [], [], 60)
        finally:
            os.close(worker)
    assert ended
