"""Values of frames, cameras and lenses that are refused: what is given, and the
line of the error.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.frames import camera_file, images
from handpose.frames.cameras import KINECT2, NYU, SR305, Camera
from handpose.frames.crops import crop
from handpose.frames.images import BadFrameError, UnitError, check_unit, depth_image
from handpose.frames.inspection import inspect
from handpose.frames.lens import Lens, Undistorter, lens_of
from handpose.frames.recording import UNKNOWN, CameraInfo, DepthDecoder, sized, stored
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA
from tests.handpose.frames.test_inspection import Taken
from tests.support.bad_input import bad_inputs

U16, F32 = np.dtype(np.uint16), np.dtype(np.float32)
WIDE = Camera("own", 100.0, 104.0, 78.0, 62.0, 160, 120)
COEFFICIENTS = "expected 4, 5, 8 finite numbers: k1 k2 p1 p2 [k3 [k4 k5 k6]]"
KNOWN = "known: brown_conrady (OpenCV's), inverse_brown_conrady (RealSense's coded light), none"
UNKNOWN_CAMERA = "the camera of these frames is unknown; give --camera FILE ..., or FX,FY,U0,V0, ... --fov DEGREES, ..."
UNKNOWN_UNIT = 'float32 depth of unknown unit; give --unit 1 for mm, --unit 1000 for metres, or write "unit_mm" ...'
CROP = "crop 0: centre u {} px, v 240 px, depth {} mm with a cube of {} mm; expected finite numbers, ..."


def cut(*uvd: float, cube: float = 300) -> Callable[[], object]:
    return lambda: crop(np.ones((480, 640)), uvd, cube, NYU)


def decode(raw: np.ndarray) -> Callable[[], object]:
    return lambda: DepthDecoder((48, 64), U16, "take", CameraInfo(CAMERA, unit_mm=0.5))(raw)


def undistort(model: str, *coefficients: float) -> Callable[[], object]:
    return lambda: Undistorter(WIDE, lens_of(model, coefficients, "x"))


@pytest.mark.parametrize(
    ("fields", "values", "expected"),
    [
        (("fx", "fy"), (0, -587.0, 1e-320, np.nan, np.inf), "more than 1e-06 px"),
        (("u0", "v0"), (np.nan, np.inf), "a finite number of px"),
    ],
)
def test_invalid_intrinsics_are_rejected(
    fields: tuple[str, ...], values: tuple[float, ...], expected: str
) -> None:
    for field, value in itertools.product(fields, values):
        line = f"camera 'nyu': {field} is {value}, expected {expected}"
        with pytest.raises(ValueError, match=line):
            replace(NYU, **{field: value})


@pytest.mark.parametrize("field", ["fx", "v0"])
def test_a_camera_of_texts_is_rejected(field: str) -> None:
    with pytest.raises(ValueError, match=f"camera 'nyu': {field} is '587', expected a number"):
        replace(NYU, **{field: "587"})


@pytest.mark.parametrize("depth", [65535.6, -0.6, np.nan])
def test_depths_that_do_not_fit_are_not_clipped(depth: float) -> None:
    line = (
        r"take: depth from .* mm does not fit into 16 bits of 1 mm; expected 0 to 65535, or take a"
    )
    with pytest.raises(DataError, match=line):
        stored(np.array([[5, depth]], np.float32), 1.0, "take")


@bad_inputs(
    DataError,
    {
        "crop at no depth": (cut(320, 240, 0), CROP.format(320, 0, 300)),
        "crop at no column": (cut(np.nan, 240, 800), CROP.format("nan", 800, 300)),
        "crop of a negative cube": (cut(320, 240, 800, cube=-1), CROP.format(320, 800, -1)),
        "crop outside": (
            cut(5000, 240, 800),
            "the cube of 300 mm at u 5000, v 240, 800 mm lies outside the image",
        ),
        "crop of another size": (
            lambda: crop(np.ones((240, 320)), (100, 100, 800), 300),
            "depth image of shape (240, 320), expected (480, 640) of camera 'nyu'",
        ),
        "a list": (
            lambda: depth_image([[700.0]]),
            "depth image is a list, expected an array of numbers",
        ),
        "a name": (
            lambda: depth_image("frame.png"),
            "depth image is a str, expected an array of numbers",
        ),
        "texts": (
            lambda: depth_image(np.array([["a"]])),
            "depth image is an array of <U1, expected numbers",
        ),
        "complex": (
            lambda: depth_image(np.zeros(4, complex)),
            "depth image is an array of complex128, expected numbers",
        ),
        "three axes": (
            lambda: depth_image(np.zeros((2, 2, 1))),
            "depth image of shape (2, 2, 1), expected (height, width)",
        ),
        "metres": (
            lambda: check_unit(np.array([[0.5, 0, np.nan, 1.2]])),
            UnitError,
            "depths from 0.5 to 1.2, expected mm; they may be metres",
        ),
        "micrometres": (
            lambda: check_unit(np.array([[700000.0, 0]])),
            UnitError,
            "depths from 700000 to 700000, expected mm, nearer than 20000; check the unit",
        ),
        "negative": (
            lambda: check_unit(np.array([[-700, 0]], np.int16)),
            UnitError,
            "depths from -700 to -700, expected mm, growing away from the camera",
        ),
        "no frame": (lambda: inspect(Taken([])), "take: no frame in it"),
        "a lens without inverse": (
            undistort("inverse_brown_conrady", -9, 0, 0, 0),
            "distortion (-9.0, 0.0, 0.0, 0.0) cannot be inverted over the picture; check it",
        ),
        "a lens of nothing": (
            undistort("brown_conrady", 1e300, 1e300, 0, 0),
            "distortion (1e+300, 1e+300, 0.0, 0.0) leaves 0% of the picture; check it",
        ),
        "a lens of little": (
            undistort("brown_conrady", -30, 0, 0, 0),
            "distortion (-30.0, 0.0, 0.0, 0.0) leaves ...% of the picture; check it",
        ),
        "one coefficient": (lambda: Lens((0.1,)), f"distortion (0.1,), {COEFFICIENTS}"),
        "six coefficients": (
            lambda: Lens((0.1,) * 6),
            f"distortion (0.1, 0.1, 0.1, 0.1, 0.1, 0.1), {COEFFICIENTS}",
        ),
        "a NaN coefficient": (
            lambda: Lens((np.nan, 0, 0, 0)),
            f"distortion (nan, 0, 0, 0), {COEFFICIENTS}",
        ),
        "a misspelt lens": (
            lambda: lens_of("brown_conrad", (0.1, 0, 0, 0, 0), "x"),
            f"x: distortion model 'brown_conrad' is not known (did you mean 'brown conrady'?); {KNOWN}",
        ),
        "no lens with coefficients": (
            lambda: lens_of("none", (0.1, 0, 0, 0, 0), "x"),
            "x: distortion (0.1, 0.0, 0.0, 0.0, 0.0) of the model 'none', which has none",
        ),
        "another lens": (
            lambda: lens_of("kannala_brandt4", (0.1, 0, 0, 0, 0), "x"),
            f"x: distortion model 'kannala_brandt4' is not known; {KNOWN}",
        ),
        "a frame of 8 bits": (
            decode(np.zeros((48, 64), np.uint8)),
            "take: values of type uint8; expected depths, of 16 bits or more",
        ),
        "a frame of colours": (
            decode(np.zeros((48, 64, 3), np.uint16)),
            "take: shape (48, 64, 3); the camera has 64 x 48",
        ),
        "a negative integer": (
            decode(np.full((48, 64), -2, np.int16)),
            "take: a depth of -1 mm; expected 0 where nothing was read, else more",
        ),
        "no camera": (
            lambda: DepthDecoder((48, 64), U16, "take", UNKNOWN),
            f"take: {UNKNOWN_CAMERA}",
        ),
        "no unit": (
            lambda: DepthDecoder((48, 64), F32, "take", CameraInfo(CAMERA)),
            f"take: {UNKNOWN_UNIT}",
        ),
        "no unit of floats": (
            lambda: DepthDecoder((480, 640), F32, "take", CameraInfo(SR305)),
            f"take: {UNKNOWN_UNIT}",
        ),  # the unit of the camera's own images is known
        "an upright frame": (
            lambda: sized(CAMERA, (64, 48), "take"),
            "take: 48 x 64 pixels; camera own has 64 x 48",
        ),
        "frames at once": (
            lambda: sized(CAMERA, (4, 48, 64), "take"),
            "take: frames of shape (4, 48, 64), expected (height, width)",
        ),
    },
)
def test_invalid_values_are_rejected(given: Callable[[], object], rejected: Any) -> None:
    with rejected:
        given()


@bad_inputs(
    DataError,
    {
        "no file": (
            lambda tmp: images.read_png(tmp / "none.png"),
            BadFrameError,
            "...none.png: no such file",
        ),
        "a folder": (
            lambda tmp: images.read_png(tmp),
            BadFrameError,
            "...: truncated, damaged or no PNG",
        ),
        "cut": (
            lambda tmp: images.read_picture(tmp / "cut.png"),
            "...cut.png: truncated or damaged PNG",
        ),
        "empty": (
            lambda tmp: images.read_picture(tmp / "empty.png"),
            "...empty.png: not an image that OpenCV can decode (0 bytes)",
        ),
        "another size": (
            lambda tmp: images.read_frame(tmp / "frame.png", CameraInfo(KINECT2)),
            "...frame.png: 40 x 30 pixels; camera kinect2 has 512 x 424",
        ),
        "no camera": (
            lambda tmp: images.read_frame(tmp / "frame.png", UNKNOWN),
            f"...frame.png: {UNKNOWN_CAMERA}",
        ),
        "no camera.json": (
            lambda tmp: camera_file.read(tmp / "none.json"),
            "...none.json: cannot read the camera: No ...",
        ),
    },
)
def test_invalid_files_are_rejected(
    tmp_path: Path, given: Callable[[Path], object], rejected: Any, rng: np.random.Generator
) -> None:
    content = cv2.imencode(".png", rng.integers(0, 999, (30, 40)).astype(np.uint16))[1].tobytes()
    for name, size in (("frame", len(content)), ("cut", len(content) * 3 // 4), ("empty", 0)):
        (tmp_path / f"{name}.png").write_bytes(content[:size])
    with rejected:
        given(tmp_path)
