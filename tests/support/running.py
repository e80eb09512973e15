"""Run commands and programs for tests: in this process, or in a separate one where the process
itself is tested.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]


class Done(NamedTuple):
    """The exit status of a program, and its standard output and standard error."""

    status: int
    out: str
    err: str


def run_tool(command: str, *argv: object, status: int | None = 0) -> Done:
    """Run ``main`` of a command in this process; it must end with ``status``, unless that is None.

    ``run_tool("train solver.prototxt --seed 1")`` runs tools/train.py; a name with a dot is that of
    another module. ``argv`` are more words, which may have spaces.
    """
    name, *words = command.split()
    main = importlib.import_module(name if "." in name else f"tools.{name}").main
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", newline="") for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            ended = main([*words, *map(str, argv)])
        except SystemExit as stopped:
            ended = stopped.code
    texts = []
    for stream in (out, err):
        stream.flush()
        texts.append(stream.buffer.getvalue().decode())
    done = Done(ended, *texts)
    assert status in (None, done.status), done
    return done


def contents() -> dict[Path, bytes | None]:
    """The content of every file of the working directory and below; None for what is no file."""
    return {path: path.read_bytes() if path.is_file() else None for path in Path().rglob("*")}


def refusal(command: str, *argv: object) -> str:
    """Return the one line of error of a command, which must end with status 1 and
    change no file.
    """
    before = contents()
    (line,) = run_tool(command, *argv, status=1).err.splitlines()
    assert contents() == before
    return line


def run_python(
    *argv: object, status: int | None = 0, cwd: Path = ROOT, typed: str = "", **changes: str | None
) -> Done:
    """Run Python in a separate process, with this project on its path; it must end with
    ``status`` (None: any).

    ``typed`` is its standard input; ``changes`` are environment variables (None removes one).
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **changes}
    ended = subprocess.run(
        [sys.executable, *map(str, argv)],
        cwd=cwd,
        input=typed,
        capture_output=True,
        env={name: value for name, value in environment.items() if value is not None},
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    done = Done(ended.returncode, ended.stdout, ended.stderr)
    assert status in (None, done.status), done
    return done
