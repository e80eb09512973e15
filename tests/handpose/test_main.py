"""handpose/__main__.py: the commands handpose and netlib, with the tools as sub-commands."""

from __future__ import annotations

import configparser
import re
from pathlib import Path

from handpose import __version__
from handpose.__main__ import NET_TOOLS, PROGRAM, commands, usage
from tests.support.running import Done, run_python

ROOT = Path(__file__).resolve().parents[2]


def handpose(*words: str, status: int = 0) -> Done:
    return run_python("-m", "handpose", *words, status=status)


def netlib(*words: str, status: int = 0) -> Done:
    return run_python("-c", "from handpose.__main__ import netlib; netlib()", *words, status=status)


def test_every_tool_is_a_command() -> None:
    """Every tool is a command named with dashes, and the list has a sentence about each."""
    assert {path.name for path in (ROOT / "tools").glob("[!_]*.py")} == {path.name for path in commands().values()}
    assert {"demo", "predict", "track", "record", "train", "test", "caffe", "export-onnx"} <= set(commands())
    lines = usage(PROGRAM, commands()).splitlines()
    assert len(lines) == 4 + len(commands())
    assert all(re.fullmatch(r"  [a-z0-9-]+ +[A-Z].*[.?]", line) for line in lines[4:])


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
    expected = usage(PROGRAM, commands())
    assert handpose(status=2).out == expected
    assert handpose("--help").out == expected
    assert handpose("--version").out == f"handpose {__version__}\n"


def test_an_unknown_command() -> None:
    """An unknown command gives an error of one line."""
    done = handpose("trian", status=2)
    assert done.out == "" and done.err == (
        "handpose: error: unknown command 'trian' (did you mean 'train'?); 'handpose --help' lists them\n"
    )


def test_netlib_lists_the_tools_for_any_net() -> None:
    """``netlib`` lists its tools under short names, in order; it accepts the other names, too."""
    lines = netlib("--help").out.splitlines()
    assert lines[0] == "usage: netlib COMMAND ..."
    assert [line.split()[0] for line in lines[4:]] == list(NET_TOOLS)
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
