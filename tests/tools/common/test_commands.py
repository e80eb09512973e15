"""tools/common/commands.py: the commands handpose and netlib, with the tools as sub-commands."""

from __future__ import annotations

import configparser
import functools
import re
import signal
import sys
import warnings
from collections.abc import Callable

import pytest

import tools
from handpose import __version__
from tests.support.running import ROOT, Done, run_python
from tools.common.commands import EXAMPLES, GROUPS, NET_TOOLS, command, commands, main


def run(program: str, *words: str, status: int = 0) -> Done:
    return run_python("-m", program, *words, status=status)


@functools.cache
def listed(program: str) -> str:
    """The list of a program's commands."""
    return run(program, "--help").out


@pytest.fixture
def shown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """``shown("track", "--help")``: the output of ``handpose track --help``, run in this process,
    which is faster.
    """

    def run(*words: str) -> str:
        interrupt = signal.getsignal(signal.SIGINT)
        with (
            monkeypatch.context() as patch,
            warnings.catch_warnings(),
            pytest.raises(SystemExit) as ended,
        ):
            # as the signal and the warnings, changed by tools.begin
            patch.setattr(tools, "_is_program", False)
            patch.setattr(sys, "argv", ["handpose", *words])
            patch.setattr(sys, "path", [*sys.path])
            patch.setitem(sys.modules, "__main__", sys.modules["__main__"])
            main("handpose")
        signal.signal(signal.SIGINT, interrupt)
        assert ended.value.code == 0
        return capsys.readouterr().out

    return run


def test_every_tool_is_a_command() -> None:
    """Every tool is a command named with dashes, and the list has a sentence about each."""
    assert {path.name for path in (ROOT / "tools").glob("[!_]*.py")} == {
        path.name for path in commands().values()
    }
    assert {"demo", "predict", "track", "record", "train", "test", "caffe", "export-onnx"} <= set(
        commands()
    )
    known = [name for names in GROUPS.values() for name in names]
    assert sorted(known) == sorted(commands())
    lines = listed("handpose").splitlines()
    found = [
        match for line in lines if (match := re.fullmatch(r"  ([a-z0-9-]+) +[A-Z].*[.?]", line))
    ]
    assert [match[1] for match in found] == known
    assert [line[:-1] for line in lines if line.endswith(":")] == list(GROUPS)


def test_the_lists_have_examples() -> None:
    """tests/documents/test_help.py runs them."""
    for program, shown in EXAMPLES.items():
        for name, example in shown.items():
            assert f"{program} {name} {example}\n" in listed(program)


def test_help_of_an_installed_command_names_commands(shown: Callable[..., str]) -> None:
    """Help for ``handpose NAME`` names neither tools nor pages by their files, which are
    not installed.
    """
    for name, path in commands().items():
        text = path.read_text(encoding="utf-8")
        if "tools/" in text or "docs/" in text:
            assert not re.search(
                r"tools/\w+\.py|docs/\w+\.md|python -m mpi4py", shown(name, "--help")
            ), name
    assert "'handpose docs live'" in shown("track", "--help")
    assert re.search(r"handpose train \S+ --ranks 2", shown("train", "--help"))


@pytest.mark.parametrize(
    ("line", "status", "texts"),
    [
        ("handpose train", 2, ["usage: handpose train [-h]", "\nhandpose train: error: "]),
        (
            "handpose export_onnx --help",
            0,
            ["usage: handpose export-onnx [-h]", "handpose export-onnx prototxt/nyu_de"],
        ),
        ("handpose caffe train --help", 0, ["usage: handpose caffe [-h]"]),
        ("handpose --version", 0, [f"handpose {__version__}\n"]),
        (
            "handpose trian",
            2,
            ["handpose: error: unknown command 'trian' (did you mean 'train'?); 'handpose --help'"],
        ),
        (
            "netlib run --help",
            0,
            ["usage: netlib run [-h]", "\n    netlib run deploy.prototxt net.caffemodel cat.jpg"],
        ),
        ("netlib plot_log --help", 0, ["usage: netlib plot-log [-h]"]),
        ("netlib run-net --help", 0, ["usage: netlib run-net [-h]"]),
        ("netlib --version", 0, [f"netlib {__version__}\n"]),
        ("netlib test", 2, ["usage: netlib test [-h]", "netlib test: error: "]),
        (
            "netlib trian",
            2,
            ["netlib: error: unknown command 'trian' (did you mean 'train'?); 'netlib --help'"],
        ),
    ],
)
def test_messages_name_the_command_that_was_typed(line: str, status: int, texts: list[str]) -> None:
    """Usage, errors and examples; errors alone go to stderr."""
    done = run(*line.split(), status=status)
    said, other = (done.err, done.out) if status else (done.out, done.err)
    assert said.startswith(texts[0]) and all(text in said for text in texts)
    assert other == "" and "python tools/" not in said


def test_without_a_command() -> None:
    """The list is printed, and the status is 2."""
    assert run("handpose", status=2).out == listed("handpose")


def test_netlib_lists_the_tools_for_any_net() -> None:
    """Under short names, in order."""
    lines = listed("netlib").splitlines()
    assert lines[0] == "usage: netlib COMMAND ..."
    assert [line.split()[0] for line in lines[5:] if re.match(r"  \S", line)] == list(NET_TOOLS)
    assert set(NET_TOOLS.values()) <= {path.stem for path in commands().values()}


def test_both_are_installed() -> None:
    """The package installs both commands."""
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg", encoding="utf-8")
    assert setup["options.entry_points"]["console_scripts"].split("\n")[1:] == [
        "handpose = handpose.__main__:main",
        "netlib = netlib.__main__:main",
    ]


@pytest.mark.parametrize(
    ("typed", "names"),
    [
        ("tools/train.py", ["python tools/export_onnx.py", "python tools/test.py"]),
        ("handpose train", ["handpose export-onnx", "handpose test"]),
        ("netlib finetune", ["netlib export-onnx", "netlib score"]),
    ],
)
def test_commands_as_they_are_started(
    typed: str, names: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """``netlib test`` is tools/test_net.py."""
    monkeypatch.setattr(sys, "argv", [typed])
    assert [command("export_onnx"), command("test")] == names
    assert typed != "netlib finetune" or command("test_net") == "netlib test"
