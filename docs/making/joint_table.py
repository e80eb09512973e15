"""The table of the points of a hand and of the joints that other formats have there, which ``make docs`` writes.

<!-- table of joint formats -->
"""

from __future__ import annotations

import re
from pathlib import Path

from handpose.body.joint_formats.formats import FORMATS, FormatName, JointFormat
from handpose.body.joint_formats.points import POINTS, Point

MARK = re.compile(r"^<!-- table of joint formats -->\n(?:\|.*\n)*", re.MULTILINE)
COLUMNS: dict[FormatName, str] = {"mediapipe": "MediaPipe", "openxr": "OpenXR", "mano": "MANO"}


def current(text: str, document: Path) -> str:
    """The text of a document with the table as the code has it now."""
    return MARK.sub(lambda match: "<!-- table of joint formats -->\n" + table(), text)


def table() -> str:
    """A row for each point: how it is computed, the number and name of each format's joint there, where it is off."""
    rows = [["computed as", *COLUMNS.values(), "against the anatomical point"], ["---"] * (2 + len(COLUMNS))]
    for point in POINTS.values():
        joints = [_joints(FORMATS[name], point) for name in COLUMNS]
        if any(joints):
            terms = [
                f"`{joint}`" if weight == 1 else f"{weight:.3g} `{joint}`" for joint, weight in point.weights.items()
            ]
            computed = " + ".join(terms).replace("+ -", "− ")
            rows.append([computed, *(", ".join(f"`{joint}`" for joint in own) for own in joints), point.bias])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _joints(of: JointFormat, point: Point) -> list[str]:
    """Number and name of the joints that a format has there."""
    return [f"{number} {name}" for number, (name, at) in enumerate(of.joints.items()) if at is point]
