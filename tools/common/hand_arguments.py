"""Arguments about hands and cameras: a camera by name or intrinsics, the cube around a hand, a format of joints."""

from __future__ import annotations

import argparse

from handpose import CAMERAS, Camera
from handpose.body.joint_formats.formats import FORMAT_NAMES
from handpose.frames.crops import CUBES_MM
from tools.common.arguments import finite, finite_values

MAX_PX = 1e6  # of focal lengths and principal points, as in a camera.json


def add_joints_option(parser: argparse.ArgumentParser, where: str) -> None:
    """Add the option --joints, for tools that write hands; ``where`` says to which output it applies."""
    parser.add_argument("--joints", choices=FORMAT_NAMES, help="joints of another format and anatomical angles, "
                        f"{where} (docs/joint_formats.md)")


def camera(text: str) -> Camera:
    """Parse a camera: its name, or the four numbers FX,FY,U0,V0; frames may then have any size."""
    if text in CAMERAS:
        return CAMERAS[text]
    numbers = finite_values(text)
    if len(numbers) != 4 or min(numbers[:2]) <= 0 or max(map(abs, numbers)) > MAX_PX:
        raise argparse.ArgumentTypeError(f"expected {', '.join(CAMERAS)} or FX,FY,U0,V0 in px, the "
                                         f"intrinsics from its SDK, found {text!r}")
    return Camera("own", *numbers, width=0, height=0)


def center(text: str) -> tuple[float, ...]:
    """Parse the centre of a hand: U,V or U,V,D."""
    numbers = finite_values(text)
    if len(numbers) not in (2, 3):
        raise argparse.ArgumentTypeError(f"expected U,V or U,V,D (px, px, mm), found {text!r}")
    return numbers


def cube(text: str) -> float:
    """Parse the edge of a cube around a body in mm."""
    least, most = CUBES_MM
    number = finite(text)
    if not least <= number <= most:
        raise argparse.ArgumentTypeError(f"expected {least:g} to {most:g} mm, found {text!r}")
    return number
