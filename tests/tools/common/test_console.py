"""tools/common/console.py: exit statuses, one-line errors, and names that cannot break lines
or table cells.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable

import cv2
import pytest
from hypothesis import given

from netlib.errors import NetlibError
from netlib.system.memory import OutOfMemoryError
from tests.netlib.test_errors import ANY_TEXT
from tools.common import console
from tools.common.console import aligned, duration, guarded, say


def fails(error: BaseException) -> Callable[[Namespace], int]:
    def run(args: Namespace) -> int:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (NetlibError("net.prototxt: no layer 'a\nb'"), 1, "net.prototxt: no layer 'a\\nb'\n"),
        (
            NetlibError("a.txt: cannot read the list: gone"),
            1,
            "a.txt: cannot read the list: gone\n",
        ),
        (
            NetlibError("data/nyu/train.txt: cannot read the list: gone"),
            1,
            "data/nyu/train.txt: cannot read the list: gone; generate synthetic hands with 'python "
            "tools/make_synthetic.py', or read the NYU data set with 'python tools/prepare_nyu.py NYU_ROOT'\n",
        ),
        (
            FileNotFoundError(2, "No such file or directory", "a\x1bb"),
            1,
            "a\\x1bb: No such file or directory\n",
        ),
        (OutOfMemoryError("9.4 MB for an array"), 1, "9.4 MB for an array\n"),
        (MemoryError(), 1, "not enough memory; use a smaller batch_size\n"),
        (cv2.error("std::bad_alloc"), 1, "not enough memory; use a smaller batch_size\n"),
        (
            cv2.error(
                "OpenCV(5.0.0) alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate 9 bytes"
            ),
            1,
            "not enough memory; use a smaller batch_size\n",
        ),
        (
            ImportError("lib.so: failed to map segment", name="av"),
            1,
            "cannot load av: lib.so: failed to map segment\n",
        ),
        (
            RuntimeError("can't start new thread"),
            1,
            "cannot start a thread: too many, or not enough memory; use fewer --threads\n",
        ),
        (KeyboardInterrupt(), 130, "interrupted\n"),
    ],
)
def test_each_mistake_is_one_line(
    error: BaseException, status: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert guarded(fails(error), Namespace()) == status
    assert capsys.readouterr() == ("", line)


@given(ANY_TEXT)
def test_a_name_stays_in_its_line(name: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        lines: list[tuple[object, ...]] = []
        patch.setattr(
            console, "print", lambda *words, sep, file: lines.append(words), raising=False
        )
        say(f"wrote {name}")
    assert all(str(word).isprintable() for word in lines[0])
    rows = aligned([["a", name], [name, "b"]]).split("\n")
    assert len(rows) == 2
    assert all(row.isprintable() for row in rows)


def test_a_table() -> None:
    assert aligned([["name", "mm"], ["a", "12.5"]]) == "name    mm\na     12.5"


@pytest.mark.parametrize(
    ("seconds", "said"), [(9.6, "10 s"), (75, "1 min 15 s"), (7260, "2 h 01 min"), (-9, "0 s")]
)
def test_durations(seconds: float, said: str) -> None:
    """Durations are rounded to seconds, from one hour on to minutes; a clock that was
    set back gives 0.
    """
    assert duration(seconds) == said
