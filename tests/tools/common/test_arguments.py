"""tools/common/arguments.py: values on the command line."""

from __future__ import annotations

import argparse
from collections.abc import Callable

import pytest

from handpose.frames.cameras import CAMERAS, KINECT2, VIEWS, Camera
from tools.common import arguments, sources

CAMERA_FORM = (
    f"a file, {', '.join((*CAMERAS, *VIEWS))}, or FX,FY,U0,V0 in px, the intrinsics from its SDK"
)


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (arguments.positive, "12", 12),
        (arguments.natural, "0", 0),
        # of 64 bits
        *((kind, str(2**63 - 1), 2**63 - 1) for kind in (arguments.positive, arguments.natural)),
        (arguments.whole(0, 100), "100", 100),
        (sources.cube, "10000", 10000.0),
        (arguments.weight, "0", 0.0),
        (arguments.weight, "1e-3", 1e-3),
        (arguments.address, "localhost:1", ("localhost", 1)),
        (arguments.address, "[::1]:0", ("::1", 0)),
        (arguments.address, "a:65535", ("a", 65535)),
        (arguments.pixels, "224x112", (224, 112)),
        (sources.camera, "kinect2", KINECT2),
        # of images of any size
        (sources.camera, "500,510,320,240", Camera("own", 500, 510, 320, 240, 0, 0)),
        (sources.center, "1,2.5", (1.0, 2.5)),
        (sources.center, "1,2,-3", (1.0, 2.0, -3.0)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_values(kind: Callable[[str], object], text: str, value: object) -> None:
    assert kind(text) == value


@pytest.mark.parametrize(
    ("kind", "text", "expected"),
    [
        (arguments.positive, "0", "an integer of at least 1"),
        (arguments.positive, "²", "an integer of at least 1"),
        (arguments.natural, "-1", "an integer of at least 0"),
        (arguments.natural, "1.0", "an integer of at least 0"),
        (arguments.natural, "9" * 5000, "an integer of at least 0"),
        *(
            (kind, str(2**63), f"an integer of at most {2**63 - 1}")
            for kind in (arguments.positive, arguments.natural)
        ),
        (arguments.whole(0, 100), "101", "an integer of at most 100"),
        (sources.cube, "0.3", "a number of at least 50 and at most 10000 mm"),
        (sources.cube, "nan", "a number of at least 50 and at most 10000 mm"),
        (sources.cube, "60,70", "a number of at least 50 and at most 10000 mm"),
        (arguments.weight, "-1", "a number of at least 0"),
        (arguments.weight, "inf", "a number of at least 0"),
        (arguments.weight, "x", "a number of at least 0"),
        *(
            (sources.camera, text, CAMERA_FORM)
            for text in ("1,2,3,nan", "0,2,3,4", "588,588,1e300,240")
        ),
        *(
            (arguments.address, text, "HOST:PORT, a port from 0 to 65535")
            for text in ("a:-1", "a:65536", ":1", "a", "a: 1", "a:" + "9" * 5000)
        ),
        (arguments.numbers(), "1,x", "numbers separated by commas"),
        (arguments.pixels, "224", "WIDTHxHEIGHT in px, such as 224x224"),
        (arguments.name_in(".png", ".jpg"), "folder/.png", "a file name with suffix .png, .jpg"),
        (sources.center, "1,2,3,4", "U,V or U,V,D (px, px, mm)"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_mistakes(kind: Callable[[str], object], text: str, expected: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError) as raised:
        kind(text)
    found = repr(text) if len(text) < 200 else f"{text[:100]!r}..."
    assert str(raised.value) == f"expected {expected}, found {found}"


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("train -solver a.b --model=c", "train --solver a.b --model=c"),
        ("-level -1 -h --help", "--level -1 -h --help"),
        ("-gray --backend lmdb in/ out", "--gray --backend lmdb in/ out"),
    ],
)
def test_caffes_flags(written: str, read: str) -> None:
    assert arguments.caffes_flags(written.split()) == read.split()
