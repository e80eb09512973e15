"""handpose/__main__.py: the commands handpose and netlib, with the tools as sub-commands."""

from __future__ import annotations

import configparser
import functools
import importlib
import re
import shlex
import signal
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

import tools
from handpose import __version__
from handpose.__main__ import EXAMPLES, GROUPS, NET_TOOLS, commands, main
from tests.support.running import Done, run_python

ROOT = Path(__file__).resolve().parents[2]


def handpose(*words: str, status: int = 0) -> Done:
    return run_python("-m", "handpose", *words, status=status)


def netlib(*words: str, status: int = 0) -> Done:
    return run_python("-c", "from handpose.__main__ import netlib; netlib()", *words, status=status)


@functools.cache
def listed(program: str) -> str:
    """The list of a program's commands."""
    return (netlib if program == "netlib" else handpose)("--help").out


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """``shown("track", "--help")``: the output of ``handpose track --help``, run in this process, which is faster."""

    def run(*words: str) -> str:
        interrupt = signal.getsignal(signal.SIGINT)
        with monkeypatch.context() as patch, warnings.catch_warnings(), pytest.raises(SystemExit) as ended:
            patch.setattr(tools, "_is_program", False)  # as the signal and the warnings, changed by tools.begin
            patch.setattr(sys, "argv", ["handpose", *words])
            patch.setattr(sys, "path", [*sys.path])
            patch.setitem(sys.modules, "__main__", sys.modules["__main__"])
            main()
        signal.signal(signal.SIGINT, interrupt)
        assert ended.value.code == 0
        return capsys.readouterr().out

    return run


def test_every_tool_is_a_command() -> None:
    """Every tool is a command named with dashes, and the list has a sentence about each."""
    assert {path.name for path in (ROOT / "tools").glob("[!_]*.py")} == {path.name for path in commands().values()}
    assert {"demo", "predict", "track", "record", "train", "test", "caffe", "export-onnx"} <= set(commands())
    known = [name for names in GROUPS.values() for name in names]
    assert sorted(known) == sorted(commands())
    lines = listed("handpose").splitlines()
    found = [match for line in lines if (match := re.fullmatch(r"  ([a-z0-9-]+) +[A-Z].*[.?]", line))]
    assert [match[1] for match in found] == known
    assert [line[:-1] for line in lines if line.endswith(":")] == list(GROUPS)


@pytest.mark.parametrize(("program", "name"), [(program, name) for program in EXAMPLES for name in EXAMPLES[program]])
def test_the_examples_parse(program: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The examples of the lists are command lines that the tools accept."""
    example, stem = EXAMPLES[program][name], NET_TOOLS.get(name, name) if program == "netlib" else name
    tool = importlib.import_module(f"tools.{stem}")
    monkeypatch.setattr(tool, "guarded", lambda run, args: 0)
    assert tool.main(shlex.split(example)) == 0
    assert f"{program} {name} {example}\n" in listed(program)


def test_help_of_an_installed_command_names_commands(shown: Callable[..., str]) -> None:
    """Help for ``handpose NAME`` names neither tools nor pages by their files, which are not installed."""
    for name, path in commands().items():
        text = path.read_text(encoding="utf-8")
        if "tools/" in text or "docs/" in text:
            assert not re.search(r"tools/\w+\.py|docs/\w+\.md|python -m mpi4py", shown(name, "--help")), name
    assert "'handpose docs live'" in handpose("track", "--help").out
    assert "mpiexec -n 4 handpose train" in handpose("train", "--help").out


def test_messages_name_the_command_that_was_typed() -> None:
    """Usage, errors and examples name the command as typed."""
    done = handpose("train", status=2)
    assert done.err.startswith("usage: handpose train [-h]") and "\nhandpose train: error: " in done.err
    done = handpose("export_onnx", "--help")
    assert done.out.startswith("usage: handpose export-onnx [-h]")
    assert "handpose export-onnx prototxt/nyu_deploy.prototxt" in done.out and "python tools/" not in done.out
    assert handpose("caffe", "train", "--help").out.startswith("usage: handpose caffe [-h]")


def test_without_a_command() -> None:
    """Without a command the list is printed and the status is 2; --help and --version succeed."""
    assert handpose(status=2).out == listed("handpose")
    assert handpose("--version").out == f"handpose {__version__}\n"


def test_an_unknown_command() -> None:
    """An unknown command gives an error of one line."""
    done = handpose("trian", status=2)
    assert done.out == "" and done.err == (
        "handpose: error: unknown command 'trian' (did you mean 'train'?); 'handpose --help' lists them\n"
    )


def test_netlib_lists_the_tools_for_any_net() -> None:
    """``netlib`` lists its tools under short names, in order; it accepts the other names, too."""
    lines = listed("netlib").splitlines()
    assert lines[0] == "usage: netlib COMMAND ..."
    assert [line.split()[0] for line in lines[5:] if re.match(r"  \S", line)] == list(NET_TOOLS)
    assert set(NET_TOOLS.values()) <= {path.stem for path in commands().values()}
    assert netlib("--version").out == f"netlib {__version__}\n"
    assert netlib("plot_log", "--help").out.startswith("usage: netlib plot-log [-h]")
    assert netlib("run-net", "--help").out.startswith("usage: netlib run-net [-h]")


def test_netlib_shows_the_short_names() -> None:
    """Help, examples and errors name the command as typed."""
    done = netlib("run", "--help")
    assert done.out.startswith("usage: netlib run [-h]")
    assert "\n    netlib run deploy.prototxt net.caffemodel cat.jpg" in done.out and "python tools/" not in done.out
    assert "netlib test: error: " in netlib("test", status=2).err
    assert "unknown command 'trian' (did you mean 'train'?); 'netlib --help'" in netlib("trian", status=2).err


def test_both_are_installed() -> None:
    """The package installs both commands."""
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg", encoding="utf-8")
    assert setup["options.entry_points"]["console_scripts"].split("\n")[1:] == [
        "handpose = handpose.__main__:main",
        "netlib = handpose.__main__:netlib",
    ]
