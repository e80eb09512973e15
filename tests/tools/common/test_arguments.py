"""tools/common/arguments.py: values on the command line."""

from __future__ import annotations

import argparse
import ast
from collections.abc import Callable
from pathlib import Path

import pytest

from handpose.frames.cameras import CAMERAS, KINECT2, VIEWS, Camera
from tests.support.tables import lines_of
from tools.common import arguments, sources

CAMERA_FORM = (
    f"a file, {', '.join((*CAMERAS, *VIEWS))}, or FX,FY,U0,V0 in px, the intrinsics from its SDK"
)


KINDS: dict[str, Callable[[str], object]] = {
    **vars(arguments),
    **vars(sources),
    "percent": arguments.whole(0, 100),
    "numbers": arguments.numbers(),
    "picture": arguments.name_in(".png", ".jpg"),
}
VALUES = [
    (KINDS[kind], text, ast.literal_eval(value))
    for kind, text, value in lines_of(Path(__file__).with_name("values.txt"))
]


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        *VALUES,
        (sources.camera, "kinect2", KINECT2),
        # of images of any size
        (sources.camera, "500,510,320,240", Camera("own", 500, 510, 320, 240, 0, 0)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_values(kind: Callable[[str], object], text: str, value: object) -> None:
    assert kind(text) == value


@pytest.mark.parametrize(
    ("kind", "text", "expected"),
    [
        *lines_of(Path(__file__).with_name("mistakes.txt")),
        ("natural", "9" * 5000, "an integer of at least 0"),
        ("address", "a:" + "9" * 5000, "HOST:PORT, a port from 0 to 65535"),
        *(("camera", text, CAMERA_FORM) for text in ("1,2,3,nan", "0,2,3,4", "588,588,1e300,240")),
    ],
)
def test_mistakes(kind: str, text: str, expected: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError) as raised:
        KINDS[kind](text)
    found = repr(text) if len(text) < 200 else f"{text[:100]!r}..."
    assert str(raised.value) == f"expected {expected}, found {found}"


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("train -solver a.b --model=c", "train --solver a.b --model=c"),
        ("-level -1 -h --help", "--level -1 -h --help"),
        ("-gray --backend lmdb in/ out", "--gray --backend lmdb in/ out"),
        ("-logtostderr train --alsologtostderr=1", "--logtostderr=true train --alsologtostderr=1"),
    ],
)
def test_caffes_flags(written: str, read: str) -> None:
    assert arguments.caffes_flags(written.split()) == read.split()
