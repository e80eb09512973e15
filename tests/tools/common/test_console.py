"""tools/common/console.py: exit statuses, one-line errors, and names that cannot break lines or table cells."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest
from hypothesis import given

from netlib.errors import NetlibError
from netlib.proto.prototxt import Place, Scalar
from netlib.system.memory import OutOfMemoryError
from tests.netlib.test_errors import ANY_TEXT
from tests.support.running import run_tool
from tests.tools.test_train import STAMP
from tools.common import console
from tools.common.console import aligned, duration, guarded, say

NASTY = "a\nI0101 00:00:00.000000 1 solver.py:1] Iteration 9, loss = 0\x1b[2J\u202e\udcff"


def fails(error: BaseException) -> Callable[[Namespace], int]:
    def run(args: Namespace) -> int:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (NetlibError("net.prototxt: no layer 'a\nb'"), 1, "net.prototxt: no layer 'a\\nb'\n"),
        (NetlibError("a.txt: cannot read the list: gone"), 1, "a.txt: cannot read the list: gone\n"),
        (NetlibError("data/nyu/train.txt: cannot read the list: gone"), 1,
         "data/nyu/train.txt: cannot read the list: gone; generate synthetic hands with 'python "
         "tools/make_synthetic.py', or read the NYU data set with 'python tools/prepare_nyu.py NYU_ROOT'\n"),
        (FileNotFoundError(2, "No such file or directory", "a\x1bb"), 1, "a\\x1bb: No such file or directory\n"),
        (OutOfMemoryError("9.4 MB for an array"), 1, "9.4 MB for an array\n"),
        (MemoryError(), 1, "not enough memory; use a smaller batch_size\n"),
        (cv2.error("std::bad_alloc"), 1, "not enough memory; use a smaller batch_size\n"),
        (cv2.error("OpenCV(5.0.0) alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate 9 bytes"), 1,
         "not enough memory; use a smaller batch_size\n"),
        (ImportError("lib.so: failed to map segment", name="av"), 1, "cannot load av: lib.so: failed to map segment\n"),
        (RuntimeError("can't start new thread"), 1,
         "cannot start a thread: too many, or not enough memory; use fewer --threads\n"),
        (KeyboardInterrupt(), 130, "interrupted\n"),
    ],
)
def test_each_mistake_is_one_line(
    error: BaseException, status: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert guarded(fails(error), Namespace()) == status
    assert capsys.readouterr() == ("", line)


def test_a_tool_that_is_done() -> None:
    assert guarded(lambda args: args.status, Namespace(status=3)) == 3


@given(ANY_TEXT)
def test_a_name_stays_in_its_line(name: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        lines: list[tuple[object, ...]] = []
        patch.setattr(console, "print", lambda *words, sep, file: lines.append(words), raising=False)
        say(f"wrote {name}")
    assert all(str(word).isprintable() for word in lines[0])
    rows = aligned([["a", name], [name, "b"]]).split("\n")
    assert len(rows) == 2 and all(row.isprintable() for row in rows)


def test_a_table() -> None:
    """The first column is left-aligned, the others are right-aligned."""
    assert aligned([["name", "mm"], ["a", "12.5"]]) == "name    mm\na     12.5"


@pytest.mark.parametrize(("seconds", "said"), [(9.6, "10 s"), (75, "1 min 15 s"), (7260, "2 h 01 min"), (-9, "0 s")])
def test_durations(seconds: float, said: str) -> None:
    """Durations are rounded to seconds, from one hour on to minutes; a clock that was set back gives 0."""
    assert duration(seconds) == said


@pytest.fixture
def nasty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver whose net, layers and blobs have names with line breaks and terminal control codes."""
    name = Scalar("string", NASTY, Place(""))
    (tmp_path / "net.prototxt").write_text(f"""
name: {name}
layer {{ name: {name} type: "DummyData" top: {name} top: "t"
        dummy_data_param {{ shape {{ dim: 2 dim: 3 }} shape {{ dim: 2 dim: 1 }} }} }}
layer {{ name: "ip" type: "InnerProduct" bottom: {name} top: "y"
        inner_product_param {{ num_output: 1 weight_filler {{ value: 1 }} }} }}
layer {{ name: "loss" type: "EuclideanLoss" bottom: "y" bottom: "t" top: "l\\033" }}
""")
    (tmp_path / "solver.prototxt").write_text(
        'net: "net.prototxt" base_lr: 0.1 lr_policy: "fixed" max_iter: 2 display: 1 debug_info: true '
        'test_iter: 1 test_interval: 1 snapshot_prefix: "a"'
    )
    monkeypatch.chdir(tmp_path)


def test_no_name_forges_a_line_of_the_log(nasty: None) -> None:
    """Every line is stamped or is a parameter of the solver, and all characters are printable."""
    lines = run_tool("train", "solver.prototxt").err.split("\n")
    assert lines.pop() == "" and all(map(str.isprintable, lines))
    assert len([line for line in lines if not re.match(STAMP, line)]) == 9
    assert not any("Iteration 9" in line and "\\n" not in line for line in lines)
