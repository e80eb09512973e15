"""Whatever the reader's code does, the check ends with its result or one line, and leaves no process."""

from __future__ import annotations

import base64
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from exercises import process
from exercises.reading import ExerciseError
from exercises.table import EXERCISES
from tests.support.running import ROOT, run_tool

SPLIT = EXERCISES["split"]
FORWARD = "y.data[...] = bottom[0].data"

Write = Callable[..., Path]


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(first: str = "", forward: str = FORWARD) -> None:
    """Write a solution of split, with code that runs when it is loaded, and another body of forward."""
    text = (ROOT / SPLIT.file).read_text(encoding="utf-8")
    assert FORWARD in text
    Path("split.py").write_text(f"{text.replace(FORWARD, f'exec({forward!r})')}\n{first}\n", encoding="utf-8")


def fault() -> str:
    """Return the error of a check of split.py; it has a generous limit."""
    with pytest.raises(ExerciseError, match=r"^split\.py(: |:\d)") as error:
        list(process.checked(SPLIT, Path("split.py"), 0, 600))
    assert str(error.value).isprintable()
    return str(error.value)


# ---------------------------------------------------------------------------------------------- the reader's code


@pytest.mark.parametrize(
    ("first", "said"),
    [
        ("import os; os._exit(0)", "its process ended with status 0 in the middle of the check; the code must not"),
        ("import os; os.closerange(0, 100)", "its process ended with status 1"),
        ("import sys; sys.exit(0)", "SystemExit: 0"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt"),
        ("import os\nfor n in range(1, 50):\n    try: os.write(n, b'{\"done\": true}\\n')\n    except OSError: pass",
         "its process sent a malformed answer"),
        ("import json; json.dumps = None", "its process ended with status 1"),
    ],
)
def test_a_file_that_does_not_return(first: str, said: str, work: Path) -> None:
    """A file that ends its process, or breaks what runs it, gives one line."""
    write(first)
    assert said in fault()


def test_an_endless_loop(work: Path) -> None:
    """A loop without end is ended after the limit."""
    write("while True: pass")
    with pytest.raises(ExerciseError, match=r"^split\.py: no progress for 0\.01 s, so its process was ended"):
        list(process.checked(SPLIT, Path("split.py"), 0, 0.01))


def test_patched_functions_do_not_pass(work: Path) -> None:
    """A wrong result is wrong, whatever functions of NumPy and of this project the file replaces in its process."""
    write("import numpy as np\nimport exercises.exercise as e\nimport exercises.checking as c\n"
          "np.allclose = np.array_equal = np.isclose = lambda *all, **more: True\n"
          "np.abs = lambda x, **more: x * 0\nnp.argwhere = np.flatnonzero = lambda x: np.zeros((0, 1), int)\n"
          "e.agree = lambda got, wanted, tolerance: got == got\nc.first_difference = lambda *all: None",
          "y.data[...] = bottom[0].data + 1")
    *_, step = process.checked(SPLIT, Path("split.py"), 0, 600)
    assert not step.passed and step.title.startswith("values")
    assert step.lines[1] == "All elements exceed the expected value by 1: a constant is superfluous or missing."


def test_what_a_student_does(work: Path) -> None:
    """Closed streams, long output, threads that go on and forks that return do not disturb a correct solution."""
    first = (
        "import os, sys, threading; print('x' * 100_000); sys.stdout.close(); sys.stdin.close(); os.fork()\n"
        "threading.Thread(target=threading.Event().wait).start()"
    )
    write(first, f"import os; os.fork(); {FORWARD}")
    assert all(step.passed for step in process.checked(SPLIT, Path("split.py"), 2, 600))


def test_a_failure_that_ends_the_process_later(work: Path) -> None:
    """The first wrong result is reported even if the code ends its process when it runs again."""
    write("calls = []", "import os; calls.append(1); len(calls) > 3 and os._exit(1); y.data[...] = 0")
    *_, step = process.checked(SPLIT, Path("split.py"), 0, 600)
    assert not step.passed and step.lines[0].startswith("y_0[n=0, c=0] is 0, the reference layer has")


# ---------------------------------------------------------------------------------------------- processes


@pytest.fixture
def alive(work: Path) -> Path:
    """A named pipe that the reader's code opens for writing: at its end, no process of that code is left."""
    os.mkfifo("alive")
    return work / "alive"


FORKS = "import os\nalive = os.open('alive', os.O_WRONLY)\nos.set_inheritable(alive, True)\nos.fork()\nos.fork()\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_processes_end_with_the_command(number: int, alive: Path) -> None:
    """When the command is interrupted or killed, all processes of the reader's code end, also those it has forked."""
    write(FORKS + "os.write(alive, b'x')\nwhile True: pass")
    words = [sys.executable, ROOT / "tools" / "exercise.py", "split"]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as command:
        with alive.open("rb", buffering=0) as stream:
            assert stream.read(1) == b"x"
            command.send_signal(number)
            while stream.read(1):
                pass
        assert command.stderr is not None
        assert command.stderr.read() == ("interrupted\n" if number == signal.SIGINT else "")
    assert command.returncode == (130 if number == signal.SIGINT else -number)


def test_processes_end_with_the_check(alive: Path) -> None:
    """Processes that the code has forked end with the check, and so does one that ends early."""
    write(FORKS + "if os.fork(): os._exit(3)\nwhile True: pass")
    stream = os.open(alive, os.O_RDONLY | os.O_NONBLOCK)
    assert "ended with status 3" in fault()
    os.set_blocking(stream, True)
    assert os.read(stream, 1) == b""
    os.close(stream)


# ---------------------------------------------------------------------------------------------- answers


def encoded(*numbers: float) -> list[object]:
    return [[len(numbers)], base64.b64encode(b"".join(map(bytes, [[0] * 8] * len(numbers)))).decode()]


OUTLINE = {"lines": {"Split.forward": 3}, "to_do": {}, "needed": []}
GARBAGE = [
    b"\xff\xfe", b"[" * 100_000, b"null", b"[]", b'"x"', b"{}", b'{"number": 1e999}', b'{"error": 3}', b"9" * 5000,
]
OUTLINES = [
    {"lines": []}, {"to_do": {"f": "1"}}, {"needed": 3}, {"needed": [None]}, {"lines": {"f": [1]}},
    {"lines": {"f": True}},
]
ANSWERS = [
    {}, {"number": 7}, {"values": 3}, {"values": {"y_0": 3}}, {"values": {"y_0": [[3], 3]}}, {"failure": "x"},
    {"values": {"y_0": [[-1], ""]}}, {"values": {"y_0": [[10**30], ""]}}, {"values": {"y_0": [[2, 3], "é"]}},
    {"values": {"y_0": [[2], "AAAA"]}}, {"values": {"y_0": [[1] * 200, "AAAAAAAAAAA="]}}, {"count": 1},
    {"values": {"y_0": [None, ""]}}, {"failure": {}}, {"failure": {"text": 3}}, {"failure": {"text": "x", "more": 1}},
]


def answers_of(*lines: object) -> str:
    """Return a program that writes lines, then waits for the end."""
    texts = [line if isinstance(line, bytes) else json.dumps(line).encode() for line in ({"ready": True}, *lines)]
    data = b"".join(text + b"\n" for text in texts)
    return f"import sys\nsys.stdout.buffer.write({data!r})\nsys.stdout.flush()\nsys.stdin.read()\n"


@pytest.mark.parametrize(
    "lines",
    [*((line,) for line in GARBAGE), *(({**OUTLINE, **other},) for other in OUTLINES),
     *((OUTLINE, {"number": 1, **answer}) for answer in ANSWERS)],
)
def test_malformed_answers(lines: tuple[object, ...], work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Anything but an answer to the last request is one line, never another exception."""
    (work / "forged.py").write_text(answers_of(*lines))
    monkeypatch.setattr(process, "WORKER", work / "forged.py")
    assert "malformed answer" in fault()


def test_forged_results_are_judged(work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays decide, not claims: a process that claims success and returns other shapes fails."""
    values = {"y_0": encoded(1, 2), "y_1": encoded(1, 2)}
    done = {"number": 1, "values": values, "passed": True, "step": ["shapes", True, []], "done": True}
    (work / "forged.py").write_text(answers_of(OUTLINE, done))
    monkeypatch.setattr(process, "WORKER", work / "forged.py")
    runs = process.checked(SPLIT, work / "split.py", 0, 600)
    assert next(runs).passed
    with process.Worker(SPLIT, Path("split.py"), 600, True) as worker:
        case = SPLIT.checks[0].cases[0]
        assert worker.run(case)["y_0"].shape == (2,)
    runs.close()


@pytest.mark.parametrize(
    ("status", "said"),
    [
        (3, "its process ended with status 3 in the middle of the check; the code must not end the process or close"),
        (-signal.SIGKILL, "was ended by SIGKILL (Killed) in the middle of the check: the system sends it when memory"),
        (
            -signal.SIGSEGV,
            "SIGSEGV (Segmentation fault) in the middle of the check: the code or a library that it uses",
        ),
        (-signal.SIGTERM, "SIGTERM (Terminated) in the middle of the check: another process, the system or the code"),
        (-signal.SIGRTMAX, "was ended by SIGRTMAX"),
    ],
)
def test_how_a_process_ended(status: int, said: str) -> None:
    """A signal is named, with what it means: not every one is the code's fault."""
    assert said in process.how_ended(status)


def test_a_signal_is_named(work: Path) -> None:
    """The command prints the signal that ended the process."""
    write("import os, signal; os.kill(os.getpid(), signal.SIGTERM)")
    assert "was ended by SIGTERM" in run_tool("exercise", "split", status=1).err
