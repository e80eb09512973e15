"""Helpers that read the contents of a page."""

from __future__ import annotations

import base64
import json
import re
from typing import Any

import cv2
import numpy as np

from layers.hand import skeleton as skeletons
from layers.hand.kinematics import Kinematics

HAND = skeletons.load()


def joints_in(tab: Any) -> np.ndarray:
    """The table of joints (K, 6): mm from the camera, and half-cubes from the crop's centre."""
    return np.array([row.split("\t")[1:] for row in tab.locator("#joints tr").all_inner_texts()], dtype=float)


def joints_of(inputs: dict[str, float]) -> np.ndarray:
    """The joints (K, 3) that Python computes for the hand, from inputs by name."""
    row = np.zeros((1, len(HAND.initial)))
    for name, value in inputs.items():
        row[0, HAND.dof_names.index(name)] = value
    return Kinematics(HAND).joints(row)[0]


def inputs_in(tab: Any) -> dict[str, float]:
    """The pose as written by the page, by name, without zeros."""
    line = json.loads(tab.locator("#pose").input_value())
    return {name: value for name, value in zip(HAND.dof_names, line) if value}


def named(tab: Any, name: str) -> None:
    """Wait until the page shows a body whose name begins with this text."""
    tab.locator("#name").filter(has_text=re.compile(f"^{re.escape(name)}")).wait_for()


def slider(tab: Any, name: str) -> Any:
    """The slider of a DoF."""
    return tab.locator(f'input[data-dof="{name}"]')


def tip(tab: Any, joint: int) -> tuple[float, float]:
    """The position of a joint in the window."""
    box = tab.locator("#stage").bounding_box()
    u, v, _ = tab.evaluate(f"hand.stage.viewer.pixel(hand.body.joints[{joint}])")
    return box["x"] + u, box["y"] + v


def colours(tab: Any) -> np.ndarray:
    """The picture's pixels (n, 4), drawn at full resolution."""
    tab.evaluate("hand.stage.draw(1)")
    return picture(tab, "stage").reshape(-1, 4)


def picture(tab: Any, canvas: str, draw: str = "null") -> np.ndarray:
    """The pixels (height, width, 4) of a canvas: red, green, blue, opacity.

    ``draw`` is evaluated immediately before, so that the page does not draw in between.
    """
    png = tab.evaluate(f"({draw}, document.getElementById('{canvas}').toDataURL())").partition(",")[2]
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), cv2.IMREAD_UNCHANGED)
    return pixels[..., [2, 1, 0, 3]]
