"""The commands of a document's bash block: check that the project's commands and their arguments exist; run them."""

from __future__ import annotations

import argparse
import configparser
import contextlib
import functools
import importlib
import importlib.util
import inspect
import io
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

from handpose import __main__ as subcommands
from netlib.files.paths import PROGRAMS

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 300  # for the commands of one block; reached by a hang only
_PYTHON = re.compile(r"(.*/)?python3?")
_ASSIGNMENT = re.compile(r"\w+=.*")
_BEFORE_COMMANDS = {"time", "exec", "if", "then", "else", "do", "while", "!", "{"}
_REDIRECTION = re.compile(r"(?<=\s)\d?>&\d|(?<=\s)\d?(?:>>?|<)\s*[^\s&|;]+")


class _ParsedError(Exception):
    """Raised when the arguments were accepted, instead of running the program."""


def commands(script: str) -> Iterator[list[str]]:
    """Yield the words of each simple command, without comments, redirections and leading assignments."""
    waiting = ""
    for line in script.replace("\\\n", " ").splitlines():
        waiting += re.sub(r"(^|\s)#(\s.*)?$", "", line) + "\n"
        try:
            lexer = shlex.shlex(_REDIRECTION.sub("", waiting), posix=True, punctuation_chars=";&|()")
            lexer.whitespace_split, lexer.commenters = True, ""
            words = list(lexer)
        except ValueError:  # a quoted string continues in the next line
            continue
        waiting = ""
        found: list[str] = []
        for word in [*words, ";"]:
            if word.strip(";&|()"):
                if found or not (_ASSIGNMENT.fullmatch(word) or word in _BEFORE_COMMANDS):
                    found.append(word)
            elif found:
                yield found
                found = []
    if waiting.strip():
        yield shlex.split(waiting)  # raises an error: an unclosed quotation


def mistakes(script: str, folder: Path) -> Iterator[str]:
    """Yield a line for each of the project's commands that does not exist or does not take its arguments.

    ``folder`` is the folder of the document's files.
    """
    try:
        found = list(commands(script))
    except ValueError as error:
        yield f"no shell can read this: {error}"
        return
    for words in found:
        if problem := _mistake(words, folder):
            yield f"{shlex.join(words)}\n{problem}"


def _mistake(words: list[str], folder: Path) -> str:
    name, *rest = words
    if name == "mpiexec":  # parse the command that every rank runs
        program = next((at for at, word in enumerate(rest) if _PYTHON.fullmatch(word)), len(rest))
        return _mistake(rest[program:], folder) if rest[program:] else ""
    if name == "make":
        unknown = [word for word in rest if "=" not in word and not word.startswith("-") and word not in targets()]
        return f"no target {', '.join(unknown)} in the Makefile" if unknown else ""
    if name == "pip" or name.endswith("/pip"):
        return _unknown_extras(rest)
    if _PYTHON.fullmatch(name):
        return _python_mistake(rest, folder)
    if name in PROGRAMS:
        return _subcommand_mistake(name, rest)
    if "/" in name and name[0] not in "/~$" and not name.startswith(".venv/") and not (ROOT / name).exists():
        return f"there is no {name}"
    return ""


def _python_mistake(words: list[str], folder: Path) -> str:
    if words[:1] == ["-m"] and words[1:2] == ["pip"]:
        return _unknown_extras(words[2:])
    if words[:2] == ["-m", "mpi4py"]:
        return _python_mistake(words[2:], folder)
    if words[:1] == ["-m"] and len(words) > 1:
        return _module_mistake(words[1], words[2:])
    script = next((word for word in words if word.endswith(".py")), None)
    if script is None or "-c" in words[: words.index(script)]:
        return ""
    if re.fullmatch(r"tools/\w+\.py", script):
        return _module_mistake(script[:-3].replace("/", "."), words[words.index(script) + 1 :])
    return "" if (folder / script).exists() else f"there is no {script}"


def _subcommand_mistake(name: str, words: list[str]) -> str:
    """Return the error of ``handpose COMMAND ...`` or ``netlib COMMAND ...``."""
    known = {word: path.stem for word, path in subcommands.commands().items()}
    known |= subcommands.NET_TOOLS if name == "netlib" else {}
    if not words or words[0].startswith("-"):
        return "" if words in (["--help"], ["--version"]) else f"{name} needs a command"
    return _module_mistake(f"tools.{known[words[0]]}", words[1:]) if words[0] in known else f"no command {words[0]}"


def _module_mistake(name: str, argv: list[str]) -> str:
    """Return the error of a program of this project: it does not exist, or its parser rejects the arguments."""
    try:
        there = importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        there = False
    if not there:
        return "" if name in _required() else f"there is no {name}"
    if not (ROOT / name.split(".")[0]).is_dir():
        return ""  # not a program of this project
    try:
        module = importlib.import_module("experiments.__main__" if name == "experiments" else name)
    except ImportError:  # of a package that only this program needs
        return ""
    main = getattr(module, "main", None)
    if main is None or not (hasattr(module, "guarded") or "argv" in inspect.signature(main).parameters):
        return ""
    if any("$" in word for word in argv):
        return ""  # only the shell can expand this
    printed = io.StringIO()
    with _only_parsing(module, name, argv), contextlib.redirect_stderr(printed), contextlib.redirect_stdout(printed):
        try:
            main(argv) if inspect.signature(main).parameters else main()
        except _ParsedError:
            pass
        except SystemExit as stopped:
            if stopped.code:
                return printed.getvalue().strip().rpartition("\n")[2] or f"it ends with {stopped.code}"
    return ""


@contextlib.contextmanager
def _only_parsing(module: object, name: str, argv: list[str]) -> Iterator[None]:
    """Within this context a program stops as soon as its arguments are parsed."""
    parse = argparse.ArgumentParser.parse_args

    def parse_and_stop(*args: object, **options: object) -> argparse.Namespace:
        parse(*args, **options)  # type: ignore[arg-type]
        raise _ParsedError

    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(sys, "argv", [name, *argv]))
        if hasattr(module, "guarded"):  # it may check more between its parser and its run
            stack.enter_context(mock.patch.object(module, "guarded", lambda run, args: 0))
        else:
            stack.enter_context(mock.patch.object(argparse.ArgumentParser, "parse_args", parse_and_stop))
        yield


@functools.cache
def targets() -> set[str]:
    """Return the targets of the Makefile."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    return {name for line in re.findall(r"^([\w./ -]+):(?!=)", text, re.MULTILINE) for name in line.split()}


@functools.cache
def _required() -> set[str]:
    """Return the packages that the extras install; a test does not need those of all extras."""
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg", encoding="utf-8")
    lines = "\n".join(setup["options.extras_require"].values()).split()
    return {name for line in lines for name in re.findall(r"^[\w-]+", line)}


def _printed_by(tool: str, argv: list[str]) -> str:
    """Return the output of a tool run in this process, errors included."""
    with io.StringIO() as out, contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            status = importlib.import_module(f"tools.{tool}").main(argv)
        except SystemExit as stopped:
            status = stopped.code
        assert not status, f"tools/{tool}.py: exit status {status}:\n{out.getvalue()[-3000:].rstrip()}"
        return out.getvalue()


def _unknown_extras(words: list[str]) -> str:
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg", encoding="utf-8")
    named = {name for word in words for extras in re.findall(r"^\.\[([^\]]*)\]", word) for name in extras.split(",")}
    unknown = named - set(setup["options.extras_require"])
    return f"no extra {', '.join(sorted(unknown))} in setup.cfg" if unknown else ""


def _tools(script: str) -> list[list[str]]:
    """Return the words of the script's commands if each starts a tool and nothing needs a shell; else an empty list."""
    found = list(commands(script))
    plain = not re.search(r"[^\w\s./,:=-]", re.sub(r"(^|\s)#.*", "", script.replace("\\\n", " ")))
    starts_tool = [words[0] == "python" and re.fullmatch(r"tools/\w+\.py", words[1]) for words in found]
    return found if plain and all(starts_tool) else []


def run(script: str, folder: Path, python: Path) -> str:
    """Run a block in the document's folder and return its output. Raises AssertionError if a command failed.

    Tools run in this process if ``folder`` is the working directory: hundreds of imports would take most of the time.
    tests/tools/test_tools.py compares the last lines of all tools, started as programs.
    ``python`` is a folder with the Python of the tests, which comes first on PATH.
    """
    tools = _tools(script) if Path.cwd() == folder else []
    if tools:
        return "".join(_printed_by(Path(name).stem, argv) for _, name, *argv in tools)
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("NETLIB", "PYTEST", "COV"))}
    environment |= {"PATH": f"{python}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT),
                    "PYTHONUNBUFFERED": "1", "PYTHONUTF8": "1", "MPLBACKEND": "Agg"}
    bash = ["bash", "-e", "-o", "pipefail", "-c", script]
    running = subprocess.Popen(bash, cwd=folder, env=environment, text=True, encoding="utf-8", start_new_session=True,
                               stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    with running:
        try:
            printed, _ = running.communicate(timeout=SECONDS)
        except subprocess.TimeoutExpired as stopped:
            raise AssertionError(f"the commands took more than {SECONDS} s") from stopped
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(running.pid, signal.SIGKILL)  # also processes that a command left running
    assert running.returncode == 0, f"exit status {running.returncode}:\n{printed[-3000:].rstrip()}"
    return printed
