"""handpose/frames/camera_file.py: camera.json with this project's keys and with those of others."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from handpose.frames import camera_file
from handpose.frames.camera_file import next_to, parse, to_text, write
from handpose.frames.cameras import Camera
from handpose.frames.lens import Lens
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs

FOUR = '"fx": 60, "fy": 61, "u0": 31.5, "v0": 23.5'


def test_the_example_of_the_docstring() -> None:
    text = (camera_file.__doc__ or "").split("\n\n")[1]
    assert parse(text, "x") == CameraInfo(
        Camera("own", 476.0, 476.0, 313.7, 242.8, 640, 480), Lens((0.1, -0.2, 0, 0, 0)), 0.125, 30.0, "x"
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{}", CameraInfo(origin="x")),
        ('{"unit_mm": 0.125}', CameraInfo(unit_mm=0.125, origin="x")),
        (f"{{{FOUR}}}", CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0), origin="x")),
        (f'{{{FOUR}, "min_range_mm": 80}}', CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0, 80.0), origin="x")),
        (f'{{{FOUR}, "distortion": [0.1, 0, 0, 0]}}',
         CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0), Lens((0.1, 0, 0, 0)), origin="x")),
        ('{"width": 64, "height": 48, "fx": 60, "fy": 61, "ppx": 31.5, "ppy": 23.5, "model": "Inverse Brown Conrady", '
         '"coeffs": [0.1, 0, 0, 0, 0], "depth_scale": 0.001, "fps": 30}',
         CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 64, 48), Lens((0.1, 0, 0, 0, 0), "inverse_brown_conrady"), 1.0,
                    30.0, "x")),
        ('{"fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5, "k1": 1, "k2": 2, "k3": 3, "k4": 4, "k5": 5, "k6": 6, "p1": 7, '
         '"p2": 8}',
         CameraInfo(Camera("own", 60, 61, 31.5, 23.5, 0, 0), Lens((1, 2, 7, 8, 3, 4, 5, 6)), origin="x")),
    ],
    ids=["nothing", "a unit", "a camera", "a range", "a list", "RealSense", "by name"],
)
def test_what_is_understood(text: str, expected: CameraInfo) -> None:
    """This project's keys, and RealSense's, are accepted."""
    assert replace(parse(text, "x"), origin="x") == expected


NUMBER, WHAT = "expected a number more than 1e-06 and at most", "known: fx, fy, u0, v0, unit_mm, rate, ..."


@bad_inputs(DataError, {
    "": "x:1:1: not JSON: Expecting value...",
    '{"fx": 60,\n"fy" 61}': "x:2:6: not JSON: Expecting ':' delimiter",
    "[1, 2]": "x: matrix is [1.0, 2.0]; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], or fx, fy, cx, cy",
    '["a"]': 'x: found ["a"]; expected {"fx": ..., "fy": ..., "u0": ..., "v0": ...}',
    '{"fx": 1e-320, "fy": 1, "u0": 1, "v0": 1}': f"x: fx is 1e-320; {NUMBER} 1e+06",
    '{"unit_mm": 1e-320}': f"x: unit_mm is 1e-320; {NUMBER} 10000",
    '{"fx": NaN}': "x: found NaN; expected finite numbers",
    "nested": ("[" * 100000, "x: not the parameters of a camera"),
    "nested in an object": ('{"a": ' + "[" * 900 + "]" * 900 + "}", "x: ..."),
    "5000 digits": ('{"fx": ' + "9" * 5000 + "}", "x: not the parameters of a camera"),
    '{"unit_m": 1}': f"x: unknown key 'unit_m' (did you mean 'unit_mm'?); {WHAT}",
    '{"focal": 1}': f"x: unknown key 'focal'; {WHAT}",
    '{"fx": 60, "fx": 61}': "x: has 'fx' twice",
    f'{{{FOUR}, "cx": 31.5}}': "x: says u0 twice, once as cx",
    '{"fx": 60, "fy": 60}': "x: has fx, but not u0 and v0",
    '{"fx": 0, "fy": 1, "u0": 1, "v0": 1}': f"x: fx is 0; {NUMBER} 1e+06",
    '{"fx": "60", "fy": 1, "u0": 1, "v0": 1}': f'x: fx is "60"; {NUMBER} 1e+06',
    '{"fx": true, "fy": 1, "u0": 1, "v0": 1}': f"x: fx is true; {NUMBER} 1e+06",
    f'{{{FOUR}, "width": 64}}': "x: has width, but not height",
    f'{{{FOUR}, "width": 64.5, "height": 48}}': "x: width is 64.5; expected a whole number",
    '{"width": 64, "height": 48}': "x: has width, but not fx, fy, u0, v0",
    '{"unit_mm": -1}': f"x: unit_mm is -1; {NUMBER} 10000",
    '{"depth_scale": "1"}': f'x: unit_mm is "1"; {NUMBER} 10000',
    '{"rate": 1e999}': f"x: rate is Infinity; {NUMBER} 10000",
    '{"distortion": [1, 2, 3]}': "x: distortion (1.0, 2.0, 3.0), expected 4, 5, 8 finite numbers: k1 k2 p1 p2 ...",
    '{"distortion": [1, "a"]}': 'x: distortion is [1, "a"]; expected a list of numbers: k1, k2, p1, p2, k3 ...',
    '{"distortion": {"modell": "none"}}': "x: distortion: unknown key 'modell' (did you mean 'model'?); known: ...",
    '{"distortion": {"model": "fisheye", "coefficients": [1, 0, 0, 0]}}':
        "x: distortion model 'fisheye' is not known; known: brown_conrady (OpenCV's), ...",
    '{"distortion": {"model": 1, "coefficients": [1, 0, 0, 0]}}': "x: model is 1; expected a text",
    '{"distortion": [0, 0, 0, 0], "k1": 0}': "x: says the distortion twice, once as k1 ...",
    '{"model": "none", "distortion": {"model": "none"}}': "x: says model twice, once as distortion",
    '{"time_unit": "msec"}': 'x: time_unit is "msec"; expected s, ms, us, ns, frames',
})
def test_what_is_refused(given: str, rejected: Any) -> None:
    with rejected:
        parse(given, "x")


positive = st.floats(1e-3, 1e4)


@example(60.0, 61.0, 31.5, 23.5, 64, None, [0.0] * 5)
@given(positive, positive, st.floats(-1e5, 1e5), st.floats(-1e5, 1e5), st.integers(0, 9000), st.none() | positive,
       st.none() | st.lists(st.floats(-5, 5), min_size=5, max_size=5))
def test_every_number_returns(
    fx: float, fy: float, u0: float, v0: float, width: int, unit: float | None, lens: list[float] | None
) -> None:
    """Every number is restored bit for bit; a lens without distortion is omitted."""
    said = CameraInfo(
        Camera("any", fx, fy, u0, v0, width, 7 if width else 0), lens and Lens(tuple(lens)), unit, unit, "x"
    )
    if said.lens is not None and said.lens.is_straight:
        said = CameraInfo(said.camera, None, unit, unit, "x")
    assert parse(to_text(said), "x") == said


def test_the_unit_of_times_returns() -> None:
    said = CameraInfo(unit_mm=1.0, origin="x", time_unit="ms")
    assert parse(to_text(said), "x") == said
    assert json.loads(to_text(said)) == {"unit_mm": 1.0, "time_unit": "ms"}


def test_beside(tmp_path: Path) -> None:
    """A folder has its own camera.json; for a file, the file's own name takes precedence."""
    take = tmp_path / "take.npz"
    assert next_to(tmp_path) == next_to(take) == UNKNOWN
    write(tmp_path / "camera.json", CameraInfo(unit_mm=1.0))
    assert next_to(tmp_path).unit_mm == next_to(take).unit_mm == 1
    write(tmp_path / "take.camera.json", CameraInfo(unit_mm=2.0))
    assert (next_to(tmp_path).unit_mm, next_to(take).unit_mm) == (1, 2)
