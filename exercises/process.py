"""Check a reader's file in a separate process, so that a crash, an endless loop or closed streams are ordinary errors.

    for result in checked(exercise, path, iterations=20, limit_s=300):
        ...                   # a Step, or the number of iterations completed since the last result

The process writes its results as lines of JSON to a pipe that the reader's code has no access to. Output of that code
goes to stderr. The process ends with its parent, which holds the other end of its standard input.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)

import netlib  # noqa: F401  before NumPy: it chooses BLAS kernels
from exercises.checking import Step, first_step, in_network, steps
from exercises.exercise import Exercise
from exercises.reading import ExerciseError, ReadersFile, describe
from exercises.table import EXERCISES
from netlib.building import python_layer
from netlib.errors import NetlibError

# ---------------------------------------------------------------------------------------------- the parent


def checked(
    exercise: Exercise, path: Path, iterations: int, limit_s: float, python_layers: bool = True
) -> Iterator[Step | int]:
    """Yield the result of each step, and the iterations completed in the last.

    Raises ExerciseError, also if there is no result for ``limit_s`` seconds; KeyboardInterrupt if the reader's code
    does.
    """
    words = [exercise.name, str(path), str(iterations), str(int(python_layers))]
    with tempfile.TemporaryDirectory(prefix="exercise.") as folder, contextlib.ExitStack() as stack:
        child = subprocess.Popen(
            [sys.executable, __file__, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={**os.environ, "TMPDIR": folder}, start_new_session=True,
        )  # fmt: skip
        stack.enter_context(child)
        stack.callback(child.kill)
        lines: queue.Queue[bytes] = queue.Queue()
        threading.Thread(target=_read, args=(child.stdout, lines), daemon=True).start()
        limit: float | None = None  # none while modules are imported
        while True:
            try:
                line = lines.get(timeout=limit)
            except queue.Empty:
                raise ExerciseError(f"{path}: no progress for {limit_s:g} s, so its process was ended; look for an "
                                    "endless loop, or use a larger --limit") from None  # fmt: skip
            if not line:
                raise ExerciseError(f"{path}: its process ended with status {child.wait()} in the middle of the check; "
                                    "the code must not exit or crash") from None  # fmt: skip
            news = json.loads(line)
            if "step" in news:
                yield Step(*news["step"])
            elif "count" in news:
                yield news["count"]
            elif "error" in news:
                raise ExerciseError(news["error"])
            elif "interrupted" in news:
                raise KeyboardInterrupt
            elif "done" in news:
                return
            limit = limit_s


def _read(stream: IO[bytes], lines: queue.Queue[bytes]) -> None:
    """Put every line of a stream into the queue, then an empty one at its end."""
    for line in stream:
        lines.put(line)
    lines.put(b"")


# ---------------------------------------------------------------------------------------------- the child


def _run(name: str, path: str, iterations: str, python_layers: str) -> None:
    """Check a file and send the results."""
    parent, news = os.dup(0), os.fdopen(os.dup(1), "w", encoding="ascii")
    nowhere = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nowhere, 0)
    os.dup2(2, 1)

    def end_with_parent() -> None:
        os.read(parent, 1)
        os._exit(1)

    def send(**what: Any) -> None:
        print(json.dumps(what), file=news, flush=True)

    threading.Thread(target=end_with_parent, daemon=True).start()
    send(ready=True)
    try:
        with python_layer.allowed(bool(int(python_layers))):
            _check(EXERCISES[name], Path(path), int(iterations), send)
    except KeyboardInterrupt:
        send(interrupted=True)
    except BaseException as error:
        send(error=str(error) if isinstance(error, NetlibError) else describe(error))
    else:
        send(done=True)
    os._exit(0)  # does not wait for threads that the reader's code has left


def _check(exercise: Exercise, path: Path, iterations: int, send: Any) -> None:
    def report(step: Step) -> None:
        send(step=[step.title, step.passed, step.lines])

    reader = ReadersFile(exercise, path)
    report(first_step(exercise, reader))
    for step in steps(exercise, reader.part, reader):
        report(step)
    if step.passed and iterations:
        report(in_network(exercise, reader.part, iterations, reader, lambda count: send(count=count)))


if __name__ == "__main__":
    _run(*sys.argv[1:])
