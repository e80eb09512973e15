"""Real ``mpiexec``: programs of several ranks are run, or started and watched.

Skips if there is none.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.running import ROOT
from tools.common.ranks import launcher

PROGRAMS = Path(__file__).with_name("rank_programs.py")
TRAIN, CAFFE = ROOT / "tools" / "train.py", ROOT / "tools" / "caffe.py"
TIMEOUT_S = 300  # reached by a hang only
MPIEXEC = launcher()

needs_mpi = pytest.mark.skipif(
    MPIEXEC is None or importlib.util.find_spec("mpi4py") is None,
    reason="no mpi4py, or no mpiexec: pip install mpi4py mpich",
)


def command(count: int, *words: object, by: tuple[str, ...] = ("-m", "mpi4py")) -> list[str]:
    """Return the command for a Python program on several ranks.

    Each writes its process id into pid.RANK of the working directory, and runs in the folder
    rank.RANK of it, if there is one.
    """
    shell = 'echo $$ > pid.$PMI_RANK; if [ -d rank.$PMI_RANK ]; then cd rank.$PMI_RANK; fi; exec "$0" "$@"'
    return [
        str(MPIEXEC),
        "-n",
        str(count),
        "sh",
        "-c",
        shell,
        sys.executable,
        *by,
        *map(str, words),
    ]


def run(
    count: int, *words: object, by: tuple[str, ...] = ("-m", "mpi4py")
) -> subprocess.CompletedProcess[str]:
    """Run it to its end, with standard output and error separate."""
    return subprocess.run(
        command(count, *words, by=by), capture_output=True, text=True, timeout=TIMEOUT_S
    )


@contextlib.contextmanager
def started(count: int, *words: object) -> Iterator[subprocess.Popen[str]]:
    """Start it with both outputs in one; it ends with all its ranks when the block ends."""
    with subprocess.Popen(
        command(count, *words),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            for path in Path().glob("pid.*"):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(int(path.read_text()), signal.SIGKILL)


def lines_until(process: subprocess.Popen[str], wanted: str) -> list[str]:
    """Return the lines it writes, up to one with these words."""
    lines = []
    for line in process.stdout or ():
        lines.append(line.rstrip("\n"))
        if wanted in line:
            return lines
    raise AssertionError("\n".join([f"no line with {wanted!r}:", *lines]))


def ours(text: str) -> list[str]:
    """Return a program's own lines, without those of the log and of the launcher."""
    return [
        line
        for line in text.splitlines()
        if line.startswith(("rank", "no response", "usage", "train.py"))
    ]
