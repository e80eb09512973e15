"""Arguments about hands and cameras: a camera by name or intrinsics, the cube around a hand, a format of joints."""

from __future__ import annotations

import argparse

from handpose import CAMERAS, Camera
from handpose.body.joint_formats.formats import FORMAT_NAMES
from handpose.estimate.hand import MIN_CONFIDENCE, MIN_PRESENCE
from handpose.frames.camera_file import INTRINSICS, RANGES
from handpose.frames.cameras import VIEWS, View, by_field_of_view
from handpose.frames.crops import CUBES_MM
from tools.common.arguments import expected, numbers, real


def add_joints_option(parser: argparse.ArgumentParser, where: str) -> None:
    """Add the option --joints, for tools that write hands; ``where`` says to which output it applies."""
    parser.add_argument("--joints", choices=FORMAT_NAMES, help="joints of another format and anatomical angles, "
                        f"{where} (docs/joint_formats.md)")


def add_min_confidence(parser: argparse.ArgumentParser) -> None:
    """Add the option --min-confidence, for tools that write hands."""
    parser.add_argument("--min-confidence", type=real(0, 1), default=MIN_CONFIDENCE, metavar="P",
                        help="give no joints of a hand with a lower confidence, from 0 to 1 (default: %(default)s)")


def add_min_presence(parser: argparse.ArgumentParser) -> None:
    """Add the option --min-presence, for tools that look for hands."""
    parser.add_argument("--min-presence", type=real(0, 1), default=MIN_PRESENCE, metavar="P",
                        help="ignore what is a hand with a lower probability, from 0 to 1 (default: %(default)s)")


def camera(text: str) -> Camera | View:
    """Parse a camera: its name, or the four numbers FX,FY,U0,V0; frames may then have any size."""
    known: dict[str, Camera | View] = {**CAMERAS, **VIEWS}
    if text.lower() in known:
        return known[text.lower()]
    form = f"a file, {', '.join(known)}, or FX,FY,U0,V0 in px, the intrinsics from its SDK"
    fx, fy, u0, v0 = four = numbers(form, [4])(text)
    if not all(RANGES[key][0] < value <= RANGES[key][1] for key, value in zip(INTRINSICS, four)):
        raise expected(form, text)
    return Camera("own", fx, fy, u0, v0, width=0, height=0)


def field_of_view(text: str) -> View:
    """Parse a field of view in degrees: DEGREES, horizontally, or DEGREES,DEGREES with the vertical one."""
    form = "degrees between 1 and 179: horizontally, or horizontally,vertically"
    degrees = numbers(form, [1, 2])(text)
    if not all(1 <= one <= 179 for one in degrees):
        raise expected(form, text)
    return by_field_of_view(f"of {text} degrees", *degrees)


center = numbers("U,V or U,V,D (px, px, mm)", [2, 3])  # of a hand
cube = real(*CUBES_MM, unit="mm")  # edge of the cube around a body
