"""The commands of a document's bash block: run them, or check only that programs accept
their arguments.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import importlib
import io
import itertools
import os
import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

from tests.support.running import ROOT, run_tool
from tools.common import commands as subcommands

SETUP = (ROOT / "setup.cfg").read_text(encoding="utf-8")
PROGRAMS = ("handpose", "netlib")
SECONDS = 300  # for the commands of one block; reached by a hang only


def run(script: str, folder: Path) -> str:
    """Run a block in the document's folder and return its output.

    Raises AssertionError if a command failed.

    Blocks of tools alone run in this process if ``folder`` is the working directory, because
    imports take most of the time; tests/tools/test_tools.py starts every tool as a program. The
    folder's ``.venv/bin`` comes first on PATH.
    """
    words = [shlex.split(line) for line in lines_of(script)]
    plain = not re.search(r"[^\w\s./,:=-]", "".join(lines_of(script)))
    if (
        plain
        and Path.cwd() == folder
        and all(re.fullmatch(r"python tools/\w+\.py", " ".join(w[:2])) for w in words)
    ):
        done = [run_tool(Path(name).stem, *argv) for _, name, *argv in words]
        return "".join(one.out + one.err for one in done)
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("NETLIB", "PYTEST", "COV"))
    }
    environment |= {
        "PATH": f"{folder / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "PYTHONUNBUFFERED": "1",
        "PYTHONUTF8": "1",
        "MPLBACKEND": "Agg",
    }
    done = subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", script],
        cwd=folder,
        env=environment,
        text=True,
        encoding="utf-8",
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=SECONDS,
        check=False,
    )
    assert done.returncode == 0, f"exit status {done.returncode}:\n{done.stdout[-3000:].rstrip()}"
    return done.stdout


def lines_of(script: str) -> list[str]:
    """The lines of a script, without comments and continued lines joined."""
    lines = (
        re.sub(r"(^|\s)#.*$", "", line).strip() for line in script.replace("\\\n", " ").splitlines()
    )
    return [line for line in lines if line]


def mistakes(script: str) -> Iterator[str]:
    """Yield a line for each of the project's commands that does not exist or does not accept
    its arguments.
    """
    for line in lines_of(script):
        lexer = shlex.shlex(line, posix=True, punctuation_chars=";&|<>()")
        lexer.whitespace_split = True
        for end, group in itertools.groupby(lexer, lambda word: set(word) <= set(";&|<>()")):
            words = list(itertools.dropwhile(re.compile(r"\w+=").match, group))
            if "mpiexec" in words[:1]:  # the command that every rank runs
                words = list(itertools.dropwhile(lambda word: not word.startswith("python"), words))
            if not end and (problem := _mistake(words)):
                yield f"{shlex.join(words)}\n{problem}"


def _mistake(words: list[str]) -> str:
    """The reason why a command does not exist or does not accept its arguments, or
    an empty string.
    """
    name, *rest = words or [""]
    if name == "make":
        return "".join(
            f"no target {word}" for word in rest if "=" not in word and word not in targets()
        )
    if "install" in rest:
        extras = re.findall(r"[\w-]+", " ".join(re.findall(r"\.\[([\w,-]+)\]", rest[-1])))
        return "".join(
            f"no extra {extra}"
            for extra in extras
            if not re.search(rf"^{extra} =$", SETUP, re.MULTILINE)
        )
    if rest[:2] == ["-m", "mpi4py"]:
        rest = rest[2:]
    if rest[:1] == ["-m"] and rest[1] in PROGRAMS:
        name, *rest = rest[1:]
    if name in PROGRAMS:
        if not rest or rest[0].startswith("-"):
            return ""
        tools = {word: path.stem for word, path in subcommands.commands().items()}
        tools |= subcommands.NET_TOOLS if name == "netlib" else {}
        return _refused(f"tools.{tools.get(rest[0], rest[0])}", rest[1:])
    if not re.fullmatch(r"(.*/)?python3?", name):
        return ""
    first, *argv = rest[1:] if rest[:1] == ["-m"] else rest or [""]
    module = first.removesuffix(".py").replace("/", ".")
    return _refused(module, argv) if module and (ROOT / module.split(".")[0]).is_dir() else ""


def _refused(module: str, argv: list[str]) -> str:
    """The reason why a program of this project does not accept its arguments, or
    an empty string.
    """
    parse = argparse.ArgumentParser.parse_args

    def parse_and_stop(*args: object, **options: object) -> argparse.Namespace:
        parse(*args, **options)  # type: ignore[arg-type]
        raise StopIteration

    with (
        mock.patch.object(argparse.ArgumentParser, "parse_args", parse_and_stop),
        contextlib.redirect_stderr(io.StringIO()) as printed,
        contextlib.redirect_stdout(printed),
    ):
        try:
            main = getattr(importlib.import_module(module), "main", None)
            if main is not None:
                main(argv)
        except StopIteration:
            pass
        except ModuleNotFoundError as error:
            # else a package that only it needs
            return str(error) if module.startswith(str(error.name)) else ""
        except SystemExit as stopped:
            return printed.getvalue().strip().rpartition("\n")[2] if stopped.code else ""
    return ""


@functools.cache
def targets() -> set[str]:
    """The targets of the Makefile."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    return {
        name
        for line in re.findall(r"^([\w./ -]+):(?!=)", text, re.MULTILINE)
        for name in line.split()
    }
