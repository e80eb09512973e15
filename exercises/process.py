"""Check a reader's file: its code runs in a separate process (worker.py), and this one judges the arrays it returns.

    for step in checked(exercise, path, iterations=20, limit_s=300):
        ...

So a crash, an endless loop, closed streams or a patched NumPy are ordinary failures: the expected values and the
comparisons are not in the reader's process, and a malformed answer is an error. All processes that the reader's code
starts end with the check, unless they leave its process group. This is no sandbox: the code has the rights of the user.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from exercises.checking import Step, first_step, in_network, steps
from exercises.exercise import Case, Exercise, Progress, Remedy, Values
from exercises.reading import ExerciseError, Failure, Outline
from exercises.runner import PartError
from handpose.frames.json_fields import parsed
from netlib.blob import Array
from netlib.errors import NetlibError

WORKER = Path(__file__).with_name("worker.py")
MAX_ANSWER = 1 << 26  # bytes
MAX_TEXT = 1000
# Waits for the end of the process that holds the other end of its standard input, then ends a process group.
KEEPER = "import os, signal, sys; sys.stdin.buffer.read(); os.killpg(int(sys.argv[1]), signal.SIGKILL)"
SENT = "another process, the system or the code itself sent this signal"
CAUSES = {  # of signals, for messages
    "SIGKILL": "the system sends it when memory runs out",
    **dict.fromkeys(("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV"), "the code or a library that it uses crashed"),
}


def checked(
    exercise: Exercise,
    path: Path,
    iterations: int,
    limit_s: float,
    python_layers: bool = True,
    progress: Progress = lambda count: None,
) -> Iterator[Step]:
    """Yield the result of each step. ``progress`` is called with the iterations completed in the last.

    Raises ExerciseError, also if the reader's code returns nothing for ``limit_s`` seconds.
    """
    with Worker(exercise, path, limit_s, python_layers) as worker:
        step = first_step(exercise, worker.outline)
        yield step
        for step in steps(exercise, worker):
            yield step
        if step.passed and iterations:
            yield in_network(exercise, worker, iterations, progress)


class Worker:
    """The process of the reader's code, a Runner. Use it in a ``with`` statement. Raises ExerciseError."""

    outline: Outline

    def __init__(self, exercise: Exercise, path: Path, limit_s: float, python_layers: bool) -> None:
        self._exercise, self._path, self._limit_s = exercise, path, limit_s
        self._words = [exercise.name, str(path), str(int(python_layers))]
        self._cases = {
            case: (i, j) for i, check in enumerate(exercise.checks) for j, case in enumerate(check.cases)
        }
        self._number = 0  # of the last request
        self._ended: ExerciseError | None = None
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Worker:
        with contextlib.ExitStack() as stack:
            self._start(stack)
            self._next(None)  # ready: no limit while modules are imported
            self.outline = self._outline(self._next(self._limit_s))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def _start(self, stack: contextlib.ExitStack) -> None:
        folder = tempfile.TemporaryDirectory(prefix="exercise.", ignore_cleanup_errors=True)
        answers, out = os.pipe()
        try:
            child = subprocess.Popen(
                [sys.executable, str(WORKER), *self._words], stdin=subprocess.PIPE, stdout=out, bufsize=0,
                env={**os.environ, "TMPDIR": stack.enter_context(folder)}, start_new_session=True,
            )
        except BaseException:
            os.close(answers)
            raise
        finally:
            os.close(out)
        self._child = stack.enter_context(child)
        stack.callback(_end, child)
        self._queue = _Queue(answers, child)
        stack.callback(self._queue.close)
        if hasattr(os, "killpg"):
            keeper = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", KEEPER, str(child.pid)], stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
            )
            stack.enter_context(keeper)
            stack.callback(keeper.kill)
            stack.callback(_end, child)  # first, as long as the keeper runs

    # ------------------------------------------------------------------------------------------ a Runner

    def run(self, case: Case, remedy: Remedy | None = None) -> Values:
        """Return the results of a case."""
        chosen = None if remedy is None else self._exercise.remedies.index(remedy)
        answer = self._ask(case=self._cases[case], remedy=chosen)
        return self._arrays(answer)

    def train(self, iterations: int, progress: Progress) -> Array:
        """Train the paper's network."""
        answer, left = self._ask(iterations=iterations), iterations
        while "count" in answer:
            count = answer["count"]
            if type(count) is not int or not 1 <= count <= left:
                raise self._malformed()
            progress(count)
            left -= count
            answer = self._answer()
        losses = self._arrays(answer).get("loss")
        if losses is None or losses.shape != (iterations,):
            raise self._malformed()
        return losses

    # ------------------------------------------------------------------------------------------ the protocol

    def _ask(self, **request: Any) -> dict[str, Any]:
        """Send a request and return the first line of the answer. Raises PartError."""
        if self._ended:
            raise self._ended
        self._number += 1
        assert self._child.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has ended: the next line says how
            self._child.stdin.write(json.dumps({"number": self._number, **request}).encode() + b"\n")
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        answer = self._next(self._limit_s)
        if answer.get("number") != self._number:
            raise self._malformed()
        if "failure" in answer:
            raise PartError(self._failure(answer["failure"]))
        return answer

    def _next(self, limit_s: float | None) -> dict[str, Any]:
        """Return the next line that the process sends. Raises ExerciseError if none comes."""
        try:
            line = self._queue.get(limit_s)
        except queue.Empty:
            raise self._failed(f"no progress for {limit_s:g} s, so its process was ended; look for an endless loop, or "
                               "use a larger --limit") from None
        if isinstance(line, int):
            raise self._failed(how_ended(line))
        try:
            news = parsed(line.decode("ascii"), "an answer")
        except (NetlibError, UnicodeDecodeError):
            raise self._malformed() from None
        if not isinstance(news, dict):
            raise self._malformed()
        if isinstance(news.get("error"), str):
            raise ExerciseError(news["error"][:MAX_TEXT])
        return news

    def _failed(self, why: str) -> ExerciseError:
        """Return the error of a process that gives no more answers, and end it."""
        self._ended = ExerciseError(f"{self._path}: {why}")
        _end(self._child)
        return self._ended

    def _malformed(self) -> ExerciseError:
        return self._failed("its process sent a malformed answer; the code must not change the code that runs it, or "
                            "write into files that it has not opened")

    def _arrays(self, answer: Mapping[str, Any]) -> Values:
        """Decode the arrays of an answer."""
        try:
            return {name: _decoded(*array) for name, array in answer["values"].items()}
        except (AttributeError, LookupError, TypeError, ValueError, OverflowError):
            raise self._malformed() from None

    def _outline(self, news: Mapping[str, Any]) -> Outline:
        places = news.get("lines"), news.get("to_do")
        needed = news.get("needed")
        if not all(isinstance(p, dict) and all(type(n) is int for n in p.values()) for p in places):
            raise self._malformed()
        if not isinstance(needed, list) or not all(isinstance(name, str) for name in needed):
            raise self._malformed()
        return Outline(self._path, *places, frozenset(needed))  # type: ignore[arg-type]

    def _failure(self, facts: Any) -> Failure:
        kinds: dict[str, type] = {"text": str, "where": str, "function": str, "is_unwritten": bool, "assigns": bool}
        if not isinstance(facts, dict) or not facts.keys() <= kinds.keys() or "text" not in facts:
            raise self._malformed()
        if not all(value is None or isinstance(value, kinds[name]) for name, value in facts.items()):
            raise self._malformed()
        cut: dict[str, Any] = {name: v[:MAX_TEXT] if isinstance(v, str) else v for name, v in facts.items()}
        return Failure(**cut)


def _decoded(shape: Any, text: Any) -> Array:
    """Return an array. Raises TypeError, ValueError or OverflowError if it is malformed."""
    if not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError
    array: Array = np.frombuffer(base64.b64decode(text, validate=True), "<f8").reshape(shape)
    return array.astype(np.float64)


def how_ended(status: int) -> str:
    """Describe the end of the process: ``status`` is its exit status, or minus the number of a signal."""
    if status >= 0:
        return (f"its process ended with status {status} in the middle of the check; the code must not end the process "
                "or close its files")
    try:
        name, text = signal.Signals(-status).name, signal.strsignal(-status)
    except ValueError:  # a real-time signal
        name, text = f"signal {-status}", None
    described = f"{name} ({text})" if text else name
    return f"its process was ended by {described} in the middle of the check: {CAUSES.get(name, SENT)}"


class _Queue:
    """The lines that a process writes, then its exit status. A thread reads the lines, another waits for the end."""

    def __init__(self, answers: int, child: subprocess.Popen[bytes]) -> None:
        self._news: queue.Queue[bytes | int] = queue.Queue(8)  # bounded, as the process may write without end
        self._closed = False
        threading.Thread(target=self._read, args=(answers,), daemon=True).start()
        self._waiting = threading.Thread(target=self._wait, args=(child,), daemon=True)
        self._waiting.start()

    def get(self, limit_s: float | None) -> bytes | int:
        """Return the next line or the exit status. Raises queue.Empty after ``limit_s`` seconds."""
        return self._news.get(timeout=limit_s)

    def close(self) -> None:
        """Wait for the end of the process, before it is reaped, and discard the remaining lines."""
        self._closed = True
        with contextlib.suppress(queue.Empty):
            while True:  # a thread may wait for a free place
                self._news.get_nowait()
        self._waiting.join()

    def _read(self, answers: int) -> None:
        with os.fdopen(answers, "rb") as stream:
            while not self._closed and (line := stream.readline(MAX_ANSWER)):
                self._news.put(line if line.endswith(b"\n") else b"")

    def _wait(self, child: subprocess.Popen[bytes]) -> None:
        """Put the exit status. The process is not reaped where that is possible, so that its number stays its own."""
        if hasattr(os, "waitid"):
            ended = os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
            assert ended is not None
            self._news.put(ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status)
        else:
            self._news.put(child.wait())


def _end(child: subprocess.Popen[bytes]) -> None:
    """Kill a process and all others of its group."""
    if not hasattr(os, "killpg"):
        child.kill()  # this would reap it
        return
    with contextlib.suppress(ProcessLookupError, PermissionError):  # PermissionError: macOS, if all have ended
        os.killpg(child.pid, signal.SIGKILL)
