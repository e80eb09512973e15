"""Arguments about hands, cameras and sources of depth frames; opening a source, and the report on
its first frames.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from handpose import Camera, CameraInfo, Recording, open_recording
from handpose.body.joint_formats.formats import FORMAT_NAMES
from handpose.estimate.hand import MIN_CONFIDENCE
from handpose.frames import camera_file
from handpose.frames.camera_keys import INTRINSICS, RANGES
from handpose.frames.cameras import CAMERAS, UNIT_MM, VIEWS, View, by_field_of_view
from handpose.frames.crops import CUBES_MM
from handpose.frames.formats import EXPECTED
from handpose.frames.images import read_picture
from handpose.frames.inspection import Inspection, checked, view_of
from handpose.frames.lens import Lens
from handpose.frames.recording import sized
from handpose.frames.time_units import TIME_UNITS
from netlib.errors import DataError
from netlib.files.paths import exists
from tools.common.arguments import expected, numbers, real
from tools.common.console import notify, say

# confidence of a fit that confirms the depth unit: a wrong unit changes the size of the hand
CONFIRMS_UNIT = 0.95
FILES = (".json", ".yaml", ".yml", ".txt", ".ini", ".csv")  # with a camera
OTHER_UNITS = ", ".join(f"for {name} {unit:g}" for name, unit in UNIT_MM.items())
ABOUT_FRAMES = ("unit", "distortion")  # options of add_camera_options that need a camera
# argument types of values that a camera.json may also give
unit_mm, rate = (real(*RANGES[key], above=True) for key in ("unit_mm", "rate"))
center = numbers("U,V or U,V,D (px, px, mm)", [2, 3])  # of a hand
cube = real(*CUBES_MM, unit="mm")  # edge of the cube around a body


def camera(text: str) -> Camera | View:
    """Parse a camera: its name, or the four numbers FX,FY,U0,V0; frames may then have any size."""
    known: dict[str, Camera | View] = {**CAMERAS, **VIEWS}
    if text.lower() in known:
        return known[text.lower()]
    form = f"a file, {', '.join(known)}, or FX,FY,U0,V0 in px, the intrinsics from its SDK"
    intrinsics = dict(zip(INTRINSICS, numbers(form, [4])(text)))
    for key, value in intrinsics.items():
        low, high = RANGES[key]
        if not low < value <= high:
            raise expected(form, text)
    return Camera("own", **intrinsics, width=0, height=0)


def _camera(text: str) -> Camera | View | Path:
    has_suffix = Path(text).suffix.lower() in FILES
    is_name = text in {*CAMERAS, *VIEWS}
    is_file = has_suffix or (exists(Path(text)) and not is_name)
    return Path(text) if is_file else camera(text)


def _field_of_view(text: str) -> View:
    """Parse a field of view in degrees: DEGREES, horizontally, or DEGREES,DEGREES with
    the vertical one.
    """
    form = "degrees between 1 and 179: horizontally, or horizontally,vertically"
    degrees = numbers(form, [1, 2])(text)
    if not all(1 <= one <= 179 for one in degrees):
        raise expected(form, text)
    return by_field_of_view(f"of {text} degrees", *degrees)


def _lens(text: str) -> Lens:
    form = "4, 5 or 8 numbers K1,K2,P1,P2[,K3 ...]"
    try:
        return Lens(numbers(form, [4, 5, 8])(text))
    except DataError:
        raise expected(form, text) from None


def add_joints_option(parser: argparse.ArgumentParser, where: str) -> None:
    """Add the option --joints, for tools that write hands; ``where`` says to which
    output it applies.
    """
    parser.add_argument(
        "--joints",
        choices=FORMAT_NAMES,
        help=f"joints of another format and anatomical angles, {where} (docs/joint_formats.md)",
    )


def add_min_confidence(parser: argparse.ArgumentParser) -> None:
    """Add the option --min-confidence, for tools that write hands."""
    parser.add_argument(
        "--min-confidence",
        type=real(0, 1),
        default=MIN_CONFIDENCE,
        metavar="P",
        help="give no joints of a hand with a lower confidence, from 0 to 1 (default: %(default)s)",
    )


def add_source_options(parser: argparse.ArgumentParser) -> None:
    """Add the argument SOURCE and the options about its camera."""
    parser.add_argument("source", metavar="SOURCE", help=EXPECTED)
    add_camera_options(parser, "camera of the frames", "given by the source, or a file next to it")
    parser.add_argument(
        "--rate", type=rate, metavar="HZ", help="frame rate, if the frames have no times"
    )
    parser.add_argument(
        "--time-unit",
        choices=TIME_UNITS,
        help="unit of the times in file names or arrays; frames if they are numbers of frames "
        "(default: by the names)",
    )


def add_camera_options(parser: argparse.ArgumentParser, of: str, default: str = "") -> None:
    """Add the options about a camera; ``of`` begins the help, and ``default`` is where its
    parameters come from.
    """
    names = ", ".join((*CAMERAS, *VIEWS))
    by_default = f" (default: {default})" if default else ""
    camera = parser.add_mutually_exclusive_group()
    camera.add_argument(
        "--camera",
        type=_camera,
        metavar="NAME|FX,FY,U0,V0|FILE",
        help=f"{of}: {names}, four numbers in px, or a file with its intrinsics: camera.json, or as "
        f"other programs write it{by_default}",
    )
    camera.add_argument(
        "--fov",
        type=_field_of_view,
        metavar="DEGREES",
        dest="camera",
        help="if the intrinsics are unknown: the horizontal field of view of the depth image, or "
        "horizontal,vertical",
    )
    parser.add_argument(
        "--unit",
        type=unit_mm,
        metavar="MM",
        help=f"depth unit: mm per stored value of 1 (default: one, {OTHER_UNITS})",
    )
    parser.add_argument(
        "--distortion",
        type=_lens,
        metavar="K1,K2,P1,P2[,K3]",
        help="lens distortion in OpenCV's order; write --distortion= before a minus sign",
    )


def given_of(args: argparse.Namespace) -> CameraInfo:
    """The camera parameters in the parsed arguments, and in the camera.json that they name.

    Raises NetlibError.
    """
    said = CameraInfo(
        None,
        args.distortion,
        args.unit,
        getattr(args, "rate", None),
        time_unit=getattr(args, "time_unit", None),
    )
    if isinstance(args.camera, Path):
        return said.or_else(camera_file.read(args.camera))
    return said.or_else(CameraInfo(args.camera, origin="--camera"))


def frames_camera(args: argparse.Namespace) -> tuple[CameraInfo, Camera]:
    """The camera parameters for single frames, which must have a camera, and this camera.

    Raises NetlibError.
    """
    given = given_of(args)
    if given.camera is None:
        raise DataError(f"{args.camera}: has no camera; expected fx, fy, u0 and v0")
    if isinstance(given.camera, View):
        first = args.images[0]
        given = replace(given, camera=sized(given.camera, read_picture(first).shape[:2], first))
    assert isinstance(given.camera, Camera)
    return given, given.camera


def opened(args: argparse.Namespace) -> Recording:
    """Open the recording that the parsed arguments name. Raises NetlibError."""
    return open_recording(args.source, given_of(args))


def print_inspection(found: Inspection, file: TextIO | None = None) -> None:
    """Print a report on a recording and its first frames; warnings go to stderr."""
    recording = found.recording
    size = f"{recording.camera.width} x {recording.camera.height} pixels"
    rate = f", {recording.rate:g} frames/s" if recording.rate else ""
    first = f"{recording.name}: {_length_of(recording)}, {size}{rate}"
    lines = [_camera_line(recording.camera), *_depth_lines(found), *found.remarks]
    say(first, *lines, sep="\n  ", file=file)
    for warning in found.warnings:
        notify(f"warning: {recording.name}: {warning}")


def _length_of(recording: Recording) -> str:
    if recording.live:
        return "live"
    if recording.count is None:
        return "unknown number of frames"
    return f"{recording.count} frames"


def _camera_line(camera: Camera) -> str:
    across, down = view_of(camera)
    return (
        f"camera {camera.name}: fx {camera.fx:g}, fy {camera.fy:g}, u0 {camera.u0:g}, v0 {camera.v0:g}; "
        f"field of view {across:.0f} x {down:.0f} degrees"
    )


def _depth_lines(found: Inspection) -> list[str]:
    """What the first frames show; empty if they show nothing."""
    if found.depth_mm is None or found.nearest is None:
        return []
    low, middle, high = found.depth_mm
    away, wide = found.nearest
    unit_mm = found.recording.unit_mm
    return [
        f"depth {low:.0f} to {high:.0f} mm, median {middle:.0f}; {found.zeros:.0%} of the pixels empty; "
        f"unit {unit_mm:g} mm",
        f"nearest object: {away:.0f} mm away, {wide:.0f} mm wide",
    ]


def print_warnings(
    name: str,
    depth: NDArray[np.float32],
    camera: Camera,
    unit_mm: float | None,
    confidence: float = 0.0,
) -> None:
    """Print warnings about a single frame in mm; the default unit is that of the camera.

    ``confidence`` is that of the hand found in the frame; a high one confirms the unit.
    """
    found = checked([depth], camera, unit_mm)
    is_unit_confirmed = confidence >= CONFIRMS_UNIT
    warnings = [*found.of_camera, *(() if is_unit_confirmed else found.of_depths)]
    for warning in warnings:
        notify(f"warning: {name}: {warning}")


def print_new_remarks(seen: Inspection) -> None:
    """Print remarks about a recording that came up after the report on its first frames."""
    for line in (*seen.recording.remarks, seen.recording.cut):
        if line and line not in seen.remarks:
            notify(f"warning: {line}")
