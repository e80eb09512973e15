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
def list_of(program: str) -> str:
    """The list of a program's commands."""
    return run(program, "--help").out


@pytest.fixture
def help_of(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str], str]:
    """``help_of("track")``: the output of ``handpose track --help``, run in this process,
    which is faster.
    """

    def output(name: str) -> str:
        interrupt = signal.getsignal(signal.SIGINT)
        with (
            monkeypatch.context() as patch,
            warnings.catch_warnings(),
            pytest.raises(SystemExit) as ended,
        ):
            # tools.begin and main change these, the warnings and the signal; all are restored
            patch.setattr(tools, "_is_program", False)
            patch.setattr(sys, "argv", ["handpose", name, "--help"])
            patch.setattr(sys, "path", [*sys.path])
            patch.setitem(sys.modules, "__main__", sys.modules["__main__"])
            main("handpose")
        signal.signal(signal.SIGINT, interrupt)
        assert ended.value.code == 0
        return capsys.readouterr().out

    return output


def test_every_tool_is_a_command() -> None:
    files = {path.name for path in (ROOT / "tools").glob("[!_]*.py")}
    assert files == {path.name for path in commands().values()}
    known = {"demo", "predict", "track", "record", "train", "test", "caffe", "export-onnx"}
    assert known <= set(commands())


def test_the_list_has_a_sentence_about_each_command() -> None:
    """The commands are in the order of their groups, named with dashes."""
    names = [name for group in GROUPS.values() for name in group]
    assert sorted(names) == sorted(commands())
    text = list_of("handpose")
    assert re.findall(r"^  ([a-z0-9-]+) +[A-Z].*[.?]$", text, re.MULTILINE) == names
    assert re.findall(r"^(.*):$", text, re.MULTILINE) == list(GROUPS)


def test_the_lists_have_examples() -> None:
    """tests/documents/test_help.py runs them."""
    for program, examples in EXAMPLES.items():
        for name, arguments in examples.items():
            assert f"{program} {name} {arguments}\n" in list_of(program)


def test_help_of_an_installed_command_names_commands(help_of: Callable[[str], str]) -> None:
    """Help for ``handpose NAME`` names neither tools nor pages by their files, which are
    not installed.
    """
    for name, path in commands().items():
        text = path.read_text(encoding="utf-8")
        if "tools/" in text or "docs/" in text:
            files = re.findall(r"tools/\w+\.py|docs/\w+\.md|python -m mpi4py", help_of(name))
            assert not files, name
    assert "'handpose docs live'" in help_of("track")
    assert re.search(r"handpose train \S+ --ranks 2", help_of("train"))


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
        (
            "netlib finetune net w pictures",
            2,
            ["usage: netlib finetune [-h]", "('netlib docs caffe_nets')"],
        ),
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
    """In usage, errors and examples. Errors go to stderr, the rest to stdout."""
    done = run(*line.split(), status=status)
    message, other = (done.err, done.out) if status else (done.out, done.err)
    assert message.startswith(texts[0])
    assert all(text in message for text in texts)
    assert "python tools/" not in message
    assert other == ""


def test_without_a_command_the_list_is_printed() -> None:
    """The status is 2."""
    assert run("handpose", status=2).out == list_of("handpose")


def test_netlib_lists_the_tools_for_any_net() -> None:
    """Under short names, in order."""
    text = list_of("netlib")
    assert text.startswith("usage: netlib COMMAND ...\n")
    assert re.findall(r"^  (\S+)", text, re.MULTILINE) == list(NET_TOOLS)
    assert set(NET_TOOLS.values()) <= {path.stem for path in commands().values()}


def test_the_package_installs_both_commands() -> None:
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg", encoding="utf-8")
    assert setup["options.entry_points"]["console_scripts"].split("\n")[1:] == [
        "handpose = handpose.__main__:main",
        "netlib = netlib.__main__:main",
    ]


@pytest.mark.parametrize(
    ("typed", "tool", "name"),
    [
        ("tools/train.py", "export_onnx", "python tools/export_onnx.py"),
        ("tools/train.py", "test", "python tools/test.py"),
        ("handpose train", "export_onnx", "handpose export-onnx"),
        ("handpose train", "test", "handpose test"),
        ("netlib finetune", "export_onnx", "netlib export-onnx"),
        ("netlib finetune", "test", "netlib score"),
        ("netlib finetune", "test_net", "netlib test"),
    ],
)
def test_a_tool_is_named_as_the_running_command_was_typed(
    typed: str, tool: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [typed])
    assert command(tool) == name
