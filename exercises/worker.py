"""The process of the reader's code: load the file, run what process.py requests, and return arrays.

    python worker.py EXERCISE FILE PYTHON_LAYERS

Requests come from the standard input and answers go to the standard output, as lines of JSON; an array is its shape and
its float64 values in base64. Output of the reader's code goes to stderr. Nothing is compared here: the expected values
and the verdict belong to the process that asks.
"""

from __future__ import annotations

import base64
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)

import netlib  # noqa: F401  before NumPy: it chooses BLAS kernels
from exercises.exercise import Exercise
from exercises.reading import Failure, ReadersFile, describe, failure_of
from exercises.runner import LocalRunner, PartError
from exercises.table import EXERCISES
from netlib.blob import Array
from netlib.building import python_layer
from netlib.errors import NetlibError

MAX_VALUES = 1 << 21  # of all arrays of one answer


class _Channel:
    """The requests and answers. A fork of this process, or one without its descriptors, ends without an answer."""

    def __init__(self) -> None:
        self._process = os.getpid()
        self._in, self._out = os.dup(0), os.dup(1)
        self._pipes = self._identities()
        self._requests = os.fdopen(self._in, "rb")
        nowhere = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nowhere, 0)
        os.dup2(2, 1)

    def _identities(self) -> list[tuple[int, int]]:
        return [(status.st_dev, status.st_ino) for status in map(os.fstat, (self._in, self._out))]

    def _check(self) -> None:
        """Raise OSError unless this is the original process with its own two pipes."""
        if os.getpid() != self._process or self._identities() != self._pipes:
            raise OSError("not the descriptors of the answers")

    def receive(self) -> dict[str, Any] | None:
        """Return the next request, None at the end."""
        self._check()
        line = self._requests.readline()
        return json.loads(line) if line else None

    def send(self, **answer: Any) -> None:
        """Send an answer."""
        self._check()
        data = memoryview(json.dumps(answer).encode("ascii") + b"\n")
        while data:
            data = data[os.write(self._out, data) :]


def main(name: str, path: str, python_layers: str) -> None:
    """Answer requests until there are no more."""
    try:
        channel = _Channel()
        channel.send(ready=True)
        with python_layer.allowed(bool(int(python_layers))):
            _answer(channel, EXERCISES[name], Path(path))
    finally:
        os._exit(1)  # without waiting for threads that the reader's code has left


def _answer(channel: _Channel, exercise: Exercise, path: Path) -> None:
    try:
        reader = ReadersFile(exercise, path)
    except BaseException as error:
        channel.send(error=str(error) if isinstance(error, NetlibError) else f"{path}: {describe(error)}")
        channel.receive()  # the process that asks ends this one
        return
    outline = reader.outline
    channel.send(lines=outline.lines, to_do=outline.to_do, needed=sorted(outline.needed))
    runner = LocalRunner(exercise, reader.part, reader)
    while (request := channel.receive()) is not None:
        number = request["number"]
        try:
            answer = _run(channel, runner, request)
        except PartError as error:
            answer = {"failure": vars(error.failure)}
        except BaseException as error:  # KeyboardInterrupt, which only the reader's code raises here
            answer = {"failure": vars(failure_of(error, reader))}
        channel.send(number=number, **answer)


def _run(channel: _Channel, runner: LocalRunner, request: dict[str, Any]) -> dict[str, Any]:
    exercise = runner.exercise
    if "iterations" in request:

        def progress(count: int) -> None:
            channel.send(number=request["number"], count=count)

        return _encoded({"loss": runner.train(request["iterations"], progress)})
    check, case = request["case"]
    remedy = exercise.remedies[request["remedy"]] if request["remedy"] is not None else None
    return _encoded(runner.run(exercise.checks[check].cases[case], remedy))


def _encoded(arrays: Mapping[str, Array]) -> dict[str, Any]:
    """Return the answer with these arrays, or a failure if they are too large."""
    if sum(array.size for array in arrays.values()) > MAX_VALUES:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        return {"failure": vars(Failure(f"too many values to compare: {shapes}"))}
    return {"values": {
        name: [array.shape, base64.b64encode(array.astype("<f8").tobytes()).decode("ascii")]
        for name, array in arrays.items()
    }}


if __name__ == "__main__":
    main(*sys.argv[1:])
