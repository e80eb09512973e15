"""handpose/frames/camera_file.py: camera.json, its mistakes, and arbitrary texts."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from handpose.frames import camera_file
from handpose.frames.camera_file import parse, to_text
from handpose.frames.cameras import Camera
from handpose.frames.lens import Lens
from handpose.frames.recording import CameraInfo
from handpose.frames.time_units import TIME_UNITS
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs, in_table

FOUR = '"fx": 60, "fy": 61, "u0": 31.5, "v0": 23.5'


def test_the_example_of_the_docstring_is_read() -> None:
    text = (camera_file.__doc__ or "").split("\n\n")[1]
    assert parse(text, "x") == CameraInfo(
        Camera("own", 476.0, 476.0, 313.7, 242.8, 640, 480),
        Lens((0.1, -0.2, 0, 0, 0)),
        0.125,
        30.0,
        "x",
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{}", CameraInfo(origin="x")),
        ('{"unit_mm": 0.125}', CameraInfo(unit_mm=0.125, origin="x")),
        ('{"unit_mm": 0.125, "rate": null, "fx": null}', CameraInfo(unit_mm=0.125, origin="x")),
        (f"{{{FOUR}}}", CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0), origin="x")),
        (
            f'{{{FOUR}, "min_range_mm": 80}}',
            CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0, 80.0), origin="x"),
        ),
        (
            f'{{{FOUR}, "min_range_mm": 0}}',
            CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0, 0.0), origin="x"),
        ),
        (
            f'{{{FOUR}, "distortion": [0.1, 0, 0, 0]}}',
            CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0), Lens((0.1, 0, 0, 0)), origin="x"),
        ),
        (
            f'{{{FOUR}, "distortion": {{"model": null, "coeffs": [0.1, 0, 0, 0]}}}}',
            CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0), Lens((0.1, 0, 0, 0)), origin="x"),
        ),
        (
            '{"width": 64, "height": 48, "fx": 60, "fy": 61, "ppx": 31.5, "ppy": 23.5, '
            '"model": "Inverse Brown Conrady", '
            '"coeffs": [0.1, 0, 0, 0, 0], "depth_scale": 0.001, "fps": 30}',
            CameraInfo(
                Camera("own", 60, 61, 31.5, 23.5, 64, 48),
                Lens((0.1, 0, 0, 0, 0), "inverse_brown_conrady"),
                1.0,
                30.0,
                "x",
            ),
        ),
        (
            '{"fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5, "k1": 1, "k2": 2, "k3": 3, "k4": 4, '
            '"k5": 5, "k6": 6, "p1": 7, '
            '"p2": 8}',
            CameraInfo(
                Camera("own", 60, 61, 31.5, 23.5, 0, 0), Lens((1, 2, 7, 8, 3, 4, 5, 6)), origin="x"
            ),
        ),
    ],
    ids=[
        "nothing",
        "a unit",
        "null",
        "a camera",
        "a range",
        "no range",
        "a list",
        "an object",
        "RealSense",
        "by name",
    ],
)
def test_this_projects_and_realsenses_keys_are_accepted(text: str, expected: CameraInfo) -> None:
    assert replace(parse(text, "x"), origin="x") == expected


@bad_inputs(
    DataError,
    {
        **in_table(Path(__file__).with_name("camera_mistakes.txt"), "x: "),
        "": "x: not whole JSON: Expecting value...",
        "nested in an object": ('{"a": ' + "[" * 900 + "]" * 900 + "}", "x: ..."),
        "5000 digits": ("fx: " + "9" * 5000, "x: fx is Infinity; expected a number more than ..."),
        "5000 digits of JSON": (
            '{"fx": ' + "9" * 5000 + "}",
            "x: not whole JSON: Exceeds the limit ...",
        ),
        "# Camera list\n1 PINHOLE 64 48 60.5 61 31.5 23.5\n": "x: COLMAP's cameras; give --camera FX,FY,U0,V0 with ...",
        "# a comment\n1 2\nx\n3": "x: unknown key 'x'...; known: fx, ...; or give the numbers: --camera FX,FY,U0,V0",
    },
)
def test_invalid_camera_files_are_rejected(given: str, rejected: Any) -> None:
    with rejected:
        parse(given, "x")


positive = st.floats(1e-3, 1e4)


@example(60.0, 61.0, 0.0, 23.5, 64, None, [0.0] * 5, "ms")
@given(
    positive,
    positive,
    st.floats(-1e5, 1e5),
    st.floats(-1e5, 1e5),
    st.integers(0, 9000),
    st.none() | positive,
    st.none() | st.lists(st.floats(-5, 5), min_size=5, max_size=5),
    st.sampled_from([None, *TIME_UNITS]),
)
def test_a_written_camera_is_read_back_exactly(
    fx: float,
    fy: float,
    u0: float,
    v0: float,
    width: int,
    unit: float | None,
    lens: list[float] | None,
    time_unit: str | None,
) -> None:
    """A lens without distortion is omitted."""
    camera = Camera("any", fx, fy, u0, v0, width, 7 if width else 0, min_range_mm=abs(u0) % 300)
    lens = lens if lens and any(lens) else None
    info = CameraInfo(camera, lens and Lens(tuple(lens)), unit, unit, "x", time_unit)
    assert parse(to_text(info), "x") == info


@pytest.mark.parametrize("info", [CameraInfo(unit_mm=1e6), CameraInfo(rate=-1.0)])
def test_a_camera_that_cannot_be_read_is_not_written(tmp_path: Path, info: CameraInfo) -> None:
    with pytest.raises(DataError, match="expected a number more than"):
        camera_file.write(tmp_path / "camera.json", info)
    assert not [*tmp_path.iterdir()]


@settings(max_examples=300)
@given(st.text(st.sampled_from("abx01.- \n\t:=,[](){}'\"#<>"), max_size=60) | st.text(max_size=30))
def test_any_text_is_read_or_rejected(text: str) -> None:
    with contextlib.suppress(DataError):
        parse(text, "x")


@pytest.mark.parametrize(
    "text",
    ["a" * 10**6, "1" * 10**6 + "a", "fx: " + "1 " * 10**5 + "a", "a b " * 10**5, "[" * 10**5],
)
def test_long_texts_are_rejected_in_time_proportional_to_their_length(text: str) -> None:
    """A quadratic reader would take minutes."""
    with pytest.raises(DataError):
        parse(text, "x")
