"""tools/common/outputs.py: outputs that cannot be written or would overwrite an input are reported
before the work.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from netlib.errors import NetlibError
from tools.common import outputs


@pytest.fixture(autouse=True)
def folder(here: Path) -> None:
    """Make a folder with a file, a link to it and an empty folder the working directory."""
    Path("a.txt").write_text("mine")
    Path("link.txt").symlink_to("a.txt")
    Path("inner").mkdir()


@pytest.mark.parametrize("out", ["a.txt", "./a.txt", "inner/../a.txt", "link.txt"])
def test_an_input_by_whatever_name(out: str) -> None:
    for check in (outputs.refuse_inputs, outputs.check_place):
        with pytest.raises(NetlibError, match=r"txt: is read in this run; expected another output"):
            check(Path(out), [None, "b.txt", "a.txt"])
        check(Path(out), [None, "b.txt"])
    assert Path("a.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("out", "said"),
    [
        ("none/b.txt", "none/b.txt: folder none does not exist"),
        ("inner", "Is a directory"),
        ("", "Is a directory"),
        ("/", "Is a directory"),
        ("a.txt/b", "folder a.txt does not exist"),
    ],
)
def test_impossible_outputs_are_rejected(out: str, said: str) -> None:
    """The check leaves no file."""
    with pytest.raises((NetlibError, OSError), match=said):
        outputs.check_place(Path(out))
    outputs.check_place(Path("inner/b.txt"))
    assert sorted(path.name for path in Path().rglob("*")) == ["a.txt", "inner", "link.txt"]


def test_an_image_of_too_many_pixels_for_its_format() -> None:
    with pytest.raises(
        NetlibError, match=r"a\.jpg: cannot write the image: 1 x 66000 px are too many"
    ):
        outputs.write_image("a.jpg", np.zeros((66000, 1, 3), np.uint8))
