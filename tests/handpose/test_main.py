"""handpose/__main__.py: one command, with the tools as sub-commands."""

from __future__ import annotations

import re
from pathlib import Path

from handpose import __version__
from handpose.__main__ import commands, usage
from tests.support.running import Done, run_python

ROOT = Path(__file__).resolve().parents[2]


def handpose(*words: str, status: int = 0) -> Done:
    return run_python("-m", "handpose", *words, status=status)


def test_every_tool_is_a_command() -> None:
    """Every tool is a command named with dashes, and the list has a sentence about each."""
    assert {path.name for path in (ROOT / "tools").glob("[!_]*.py")} == {path.name for path in commands().values()}
    assert {"demo", "predict", "track", "record", "train", "test", "caffe", "export-onnx"} <= set(commands())
    lines = usage().splitlines()
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
    assert handpose(status=2).out == usage()
    assert handpose("--help").out == usage()
    assert handpose("--version").out == f"handpose {__version__}\n"


def test_an_unknown_command() -> None:
    """An unknown command gives an error of one line."""
    done = handpose("trian", status=2)
    assert done.out == "" and done.err == (
        "handpose: error: unknown command 'trian' (did you mean 'train'?); 'handpose --help' lists them\n"
    )
