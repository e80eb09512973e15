"""Cases run in a separate process: a crash, a hang or lack of memory is one failure and does not end the campaign.

A *case* is a function ``case(name, seed, number) -> Outcome`` of a module of this folder. A ``Worker`` is a child
process that runs one case after the other:

    with Worker() as worker:
        worker.run("tests.faults.readers", "weights", seed=0, number=17)   # Outcome("refused", "...")

The child has 4 GB of address space, and the parent enforces a time limit. A child that dies or hangs is replaced.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import importlib
import json
import os
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MEMORY = 4 << 30  # bytes of address space
LIMIT_S = 240.0  # reached by a hang only
LONGEST_S = 600
GOOD = ("refused", "read", "held")  # every other outcome is a failure


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case.

    kind    refused     rejected with a one-line error that names the file, the usual outcome
            read        the file was read, and the result is right, as far as it can be checked
            held        a promise that is not about reading was kept
            over        there is no case with this number, because the run has fewer events
            in capitals, the failures: TRACEBACK, CRASH, HANG, UNCLEAR, SILENT ...
    detail  the error line, or the place and description of a failure
    """

    kind: str
    detail: str = ""

    @property
    def failed(self) -> bool:
        """Whether the outcome is a failure."""
        return self.kind.isupper()


class BrokenPromise(Exception):  # noqa: N818
    """Raised by a case for a failure without an exception, with its outcome ``kind``."""

    def __init__(self, kind: str, detail: str) -> None:
        super().__init__(detail)
        self.kind = kind


@functools.cache
def failing_calls_library() -> str | None:
    """Path of the compiled failing_calls.c, which exists until this process ends; None without Linux or a compiler."""
    compiler = shutil.which("cc") if sys.platform == "linux" else None
    if compiler is None:
        return None
    folder = tempfile.mkdtemp(prefix="faults.")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    library, source = f"{folder}/failing_calls.so", str(Path(__file__).with_name("failing_calls.c"))
    built = subprocess.run([compiler, "-shared", "-fPIC", "-O1", source, "-o", library, "-ldl"], check=False)
    return None if built.returncode else library


class Worker:
    """A child process that runs cases."""

    def __init__(self, limit_s: float = LIMIT_S) -> None:
        self.limit_s = limit_s
        self._folder = tempfile.TemporaryDirectory(prefix="faults.")
        self._child: subprocess.Popen[bytes] | None = None
        self._children = 0

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *exception: object) -> None:
        self._end()
        self._folder.cleanup()

    def run(self, module: str, name: str, seed: int, number: int) -> Outcome:
        """Run one case; returns its outcome."""
        child = self._child or self._start()
        assert child.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has died since the last case, which is a crash, too
            child.stdin.write(json.dumps([module, name, seed, number]).encode() + b"\n")
            child.stdin.flush()
        ready, _, _ = select.select([self._answers], [], [], self.limit_s)
        if not ready:
            self._end()
            return Outcome("HANG", f"nothing after {self.limit_s:g} s")
        answer = self._answers.readline()
        if answer.endswith(b"\n"):
            return Outcome(*json.loads(answer))
        status = child.wait()
        died = f"by {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
        said = (self._place / "stderr").read_text(errors="replace").strip().splitlines()[-1:]
        self._end()
        return Outcome("CRASH", " ".join([f"the process ended {died}", *said])[:300])

    def _start(self) -> subprocess.Popen[bytes]:
        readable, writable = os.pipe()
        self._answers = os.fdopen(readable, "rb", buffering=0)
        environment = {**os.environ, "NETLIB_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        if library := failing_calls_library():
            environment["LD_PRELOAD"] = f"{library} {os.environ.get('LD_PRELOAD', '')}".strip()
        self._children += 1
        self._place = Path(self._folder.name) / str(self._children)
        self._place.mkdir()
        with open(self._place / "stderr", "wb") as stderr:
            self._child = subprocess.Popen(
                [sys.executable, "-m", "tests.faults.isolation", str(writable)], stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL, stderr=stderr, pass_fds=[writable], cwd=self._place, env=environment,
                start_new_session=True,
            )
        os.close(writable)
        return self._child

    def _end(self) -> None:
        """End the child and all processes that it started."""
        if self._child is None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._child.pid, signal.SIGKILL)
        self._child.wait()
        assert self._child.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._child.stdin.close()
        self._answers.close()
        self._child = None


def outcome_of(module: str, name: str, seed: int, number: int) -> Outcome:
    """Run a case in this process; an exception that is not a NetlibError is a failure with its place."""
    try:
        outcome: Outcome = importlib.import_module(module).case(name, seed, number)
        return outcome
    except BaseException as error:  # SystemExit, too: a reader must not end the process
        return outcome_of_error(error)


def outcome_of_error(error: BaseException) -> Outcome:
    """Convert an exception to an outcome."""
    if isinstance(error, BrokenPromise):
        return Outcome(error.kind, str(error)[:500])
    said = " ".join(str(error).split())[:160]
    return Outcome("TRACEBACK", f"{type(error).__name__} at {_place(error)}: {said}")


def _place(error: BaseException) -> str:
    """The last line of this project in a traceback, outside this folder if possible."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(ROOT))]
    ours = [f for f in frames if "/tests/" not in f.filename and "/.venv/" not in f.filename] or frames
    return f"{Path(ours[-1].filename).relative_to(ROOT)}:{ours[-1].lineno}" if ours else "nowhere"


def _serve(answers: int) -> None:
    """Main function of the child: reads cases from standard input and writes one answer for each."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for order in sys.stdin:
        signal.alarm(LONGEST_S)  # limits the time that a case can outlive the parent
        outcome = outcome_of(*json.loads(order))
        signal.alarm(0)
        text = outcome.detail.encode("utf-8", "backslashreplace").decode()
        os.write(answers, json.dumps([outcome.kind, text]).encode() + b"\n")


if __name__ == "__main__":
    from tests.faults import isolation  # by its full name, so that the BrokenPromise of the cases is caught

    isolation._serve(int(sys.argv[1]))
