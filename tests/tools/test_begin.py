"""tools/__init__.py: the start of a command's process: signals, warnings and standard streams."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import tools
from tests.support.running import Done, run_python
from tests.support.source_imports import imports_of, parsed
from tests.tools.conftest import ROOT
from tests.tools.test_tools import COMMANDS

PROGRAMS = [*(f"tools/{name}.py" for name in COMMANDS), "experiments/__main__.py"]
Run = Callable[..., Done]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """``run("tools/train.py", "solver.prototxt")`` runs Python in a separate folder."""

    def start(*argv: str, status: int = 0, **changes: str) -> Done:
        program = ROOT / argv[0] if argv[0].endswith(".py") else argv[0]
        changes = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}", **changes}
        return run_python(program, *argv[1:], status=status, cwd=tmp_path, **changes)

    return start


def interrupt_at(folder: Path, event: str, name: str) -> None:
    """Make every Python with this folder on its path interrupt itself at an import
    or open event.
    """
    (folder / "sitecustomize.py").write_text(f"""
import os, signal, sys
def hook(event, args):
    if event == {event!r} and str(args[0]).endswith({name!r}):
        os.kill(os.getpid(), signal.SIGINT)
sys.addaudithook(hook)
""")


def begun(code: str) -> list[str]:
    """Return the arguments that make Python run this code as a command after ``tools.begin``."""
    return ["-c", f"import os, subprocess, sys, tools\ntools.begin('__main__')\n{code}"]


# ------------------------------------------------------------------------------------------- Ctrl-C


def test_every_program_begins_before_it_imports_what_takes_long() -> None:
    """``tools.begin(__name__)`` is preceded only by imports of the standard library
    and of ``tools``.
    """
    for program in PROGRAMS:
        statements = parsed(ROOT / program).body
        begun = [
            i
            for i, statement in enumerate(statements)
            if ast.unparse(statement) == "tools.begin(__name__)"
        ]
        assert len(begun) == 1, program
        before = ast.Module(statements[: begun[0]], [])
        names = {name.split(".")[0] for name in imports_of(before)}
        assert names <= {*sys.stdlib_module_names, "tools"}, program


@pytest.mark.parametrize(
    "words",
    [["tools/train.py"], ["-m", "netlib", "train"], ["-m", "handpose", "train"]],
    ids=lambda words: " ".join(words),
)
def test_ctrl_c_during_the_imports(words: list[str], run: Run, tmp_path: Path) -> None:
    interrupt_at(tmp_path, "import", "numpy")
    assert run(*words, status=-signal.SIGINT)[1:] == ("", "")


def test_ctrl_c_later(run: Run, tmp_path: Path) -> None:
    (tmp_path / "net.prototxt").touch()
    interrupt_at(tmp_path, "open", "net.prototxt")
    done = run("tools/upgrade_net.py", "net.prototxt", "new.prototxt", status=130)
    assert done[1:] == ("", "interrupted\n")


def test_an_ignored_ctrl_c_stays_ignored(run: Run, tmp_path: Path) -> None:
    """SIGINT stays ignored if it was, as shells require for background jobs."""
    code = "signal.signal(signal.SIGINT, signal.SIG_IGN); sys.argv[0] = '-c'; import runpy; "
    code += f"runpy.run_path({str(ROOT / 'tools' / 'upgrade_net.py')!r}, run_name='__main__')"
    (tmp_path / "net.prototxt").touch()
    interrupt_at(tmp_path, "open", "net.prototxt")
    done = run("-c", f"import signal, sys; {code}", "net.prototxt", "new.prototxt", status=1)
    assert done.err == "net.prototxt:1:1: error: this file has no layers; expected a net\n"


# ----------------------------------------------------------------------------------- standard error


def test_numpy_s_warnings_are_not_shown(run: Run) -> None:
    """NumPy's warnings are hidden, also in threads; C libraries and child processes can still
    write to stderr.
    """
    code = """
import numpy, threading
threading.Thread(target=lambda: numpy.float32(1e38) * numpy.float32(10)).start()
os.write(2, b"a library\\n")
subprocess.run(["sh", "-c", "echo a program >&2"])
"""
    assert run(*begun(code)).err == "a library\na program\n"


def test_warnings_that_are_asked_for_are_shown(run: Run) -> None:
    assert (
        "overflow"
        in run("-W", "default", *begun("import numpy; numpy.float32(1e38) * numpy.float32(10)")).err
    )


def test_characters_that_cannot_be_encoded_are_escaped(run: Run) -> None:
    code = 'for stream in (sys.stdout, sys.stderr): print("Größe \\udcff", file=stream)'
    done = run(*begun(code), PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert done.out == done.err == "Gr\\xf6\\xdfe \\udcff\n"


def test_an_uncaught_exception_is_still_reported(run: Run) -> None:
    assert run(*begun("1 / 0"), status=1).err.endswith("ZeroDivisionError: division by zero\n")


def test_a_closed_stderr(tmp_path: Path) -> None:
    """With stderr closed, messages are lost, and no file opened later gets descriptor 2."""
    code = "import tempfile; print(tempfile.TemporaryFile().fileno() > 2); print('lost', file=sys.stderr)"
    command = ["sh", "-c", 'exec "$0" "$@" 2>&-', sys.executable, *begun(code)]
    assert subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout == b"True\n"


def test_importing_a_command_changes_neither_signals_nor_streams() -> None:
    before = sys.stderr, signal.getsignal(signal.SIGINT)
    tools.begin("tools.train")
    with tools.interruptible():
        assert (sys.stderr, signal.getsignal(signal.SIGINT)) == before
    assert (sys.stderr, signal.getsignal(signal.SIGINT)) == before


# --------------------------------------------------------------------------------- before the guard


@pytest.mark.parametrize(
    ("raised", "line"),
    [
        (
            "ImportError('libav.so.9: failed to map segment from shared object', name='av')",
            "not enough memory to load av",
        ),
        ("MemoryError()", "not enough memory to load the packages"),
        (
            "ModuleNotFoundError(\"No module named 'cv2'\", name='cv2')",
            "cannot load cv2: No module named 'cv2'",
        ),
    ],
)
def test_a_failing_import_is_one_line(run: Run, raised: str, line: str) -> None:
    assert run(*begun(f"raise {raised}"), status=1).err == f"{line}\n"


@pytest.mark.skipif(sys.platform == "win32", reason="needs rmdir of the working directory")
@pytest.mark.parametrize(
    "words", [("track", "take"), ("record", "take", "--out", "x"), ("predict", "a.png")]
)
def test_a_deleted_working_directory(tmp_path: Path, words: tuple[str, ...]) -> None:
    tool, *options = words
    code = f"import os, sys; os.rmdir(os.getcwd()); from tools import {tool}; sys.exit({tool}.main({options}))"
    (tmp_path / "gone").mkdir()
    done = run_python("-c", code, cwd=tmp_path / "gone", status=1)
    assert len(done.err.splitlines()) == 1
    assert "standard output" not in done.err
    if tool != "predict":
        assert done.err == "the working directory was deleted; change to another one\n"
