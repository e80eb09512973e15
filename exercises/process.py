"""A reader's file is checked in a process of its own, whose end, loop or closed streams are an error like any other.

    for news in checked(exercise, path, iterations=20, limit_s=300):
        ...                   # a Step, or the number of iterations that were trained since

The process writes its news as lines of JSON on a pipe that the reader's code does not know. What that code prints goes
to stderr. The process ends with its parent, which holds the other end of its standard input.
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
from exercises.reading import ExerciseError, ReadersFile, told
from exercises.table import EXERCISES
from netlib.building import python_layer
from netlib.errors import NetlibError

# ---------------------------------------------------------------------------------------------- the parent


def checked(
    exercise: Exercise, path: Path, iterations: int, limit_s: float, python_layers: bool = True
) -> Iterator[Step | int]:
    """What becomes of the steps, one by one, and of the iterations of the last.

    Raises ExerciseError, also if nothing comes for so many seconds; KeyboardInterrupt if the reader's code does.
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
        limit: float | None = None  # until the modules are there
        while True:
            try:
                line = lines.get(timeout=limit)
            except queue.Empty:
                raise ExerciseError(f"{path}: nothing has come of it for {limit_s:g} s, so it was ended; look for a "
                                    "loop without end, or give a larger --limit") from None  # fmt: skip
            if not line:
                raise ExerciseError(f"{path}: its process ended with status {child.wait()} in the middle of the check; "
                                    "it must neither exit nor crash") from None  # fmt: skip
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
    """Put every line of a stream into the queue, and an empty one at its end."""
    for line in stream:
        lines.put(line)
    lines.put(b"")


# ---------------------------------------------------------------------------------------------- the child


def _run(name: str, path: str, iterations: str, python_layers: str) -> None:
    """Check a file, and send the news."""
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
        send(error=str(error) if isinstance(error, NetlibError) else told(error))
    else:
        send(done=True)
    os._exit(0)  # whatever threads the reader's code has left


def _check(exercise: Exercise, path: Path, iterations: int, send: Any) -> None:
    def tell(step: Step) -> None:
        send(step=[step.title, step.passed, step.lines])

    reader = ReadersFile(exercise, path)
    tell(first_step(exercise, reader))
    for step in steps(exercise, reader.part, reader):
        tell(step)
    if step.passed and iterations:
        tell(in_network(exercise, reader.part, iterations, reader, lambda count: send(count=count)))


if __name__ == "__main__":
    _run(*sys.argv[1:])
