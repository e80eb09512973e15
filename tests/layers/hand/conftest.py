"""A planar arm, whose kinematics has a closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from layers.hand.skeleton import Skeleton, load

# Base at (x, y), upper arm of length 2, fore arm of length 1 along the local x axes, both turning about z.
ARM = """
    name: "arm"
    dof { name: "x" } dof { name: "y" initial: 0.5 }
    dof { name: "shoulder" initial: 0.25 lower: -1 upper: 1 } dof { name: "elbow" lower: 0 upper: 2.5 }
    joint { name: "hand" parent: "elbow" rotate { axis: Z dof: "elbow" } bone { axis: X length: 1 } }
    joint { name: "elbow" parent: "base" rotate { axis: Z dof: "shoulder" } bone { axis: X length: 2 } }
    joint { name: "base" translate { axis: X dof: "x" } translate { axis: Y dof: "y" } }
"""


def arm_joints(inputs: np.ndarray) -> np.ndarray:
    """The closed form, (N, 4) to (N, 3, 3): hand, elbow, base."""
    x, y, shoulder, elbow = inputs.T
    y, shoulder = y + 0.5, shoulder + 0.25
    base = np.stack([x, y, 0 * x], axis=1)
    upper = 2 * np.stack([np.cos(shoulder), np.sin(shoulder), 0 * x], axis=1)
    fore = np.stack([np.cos(shoulder + elbow), np.sin(shoulder + elbow), 0 * x], axis=1)
    return np.stack([base + upper + fore, base + upper, base], axis=1)


@pytest.fixture(scope="session")
def arm_text() -> str:
    """The skeleton file of the arm."""
    return ARM


@pytest.fixture(scope="session")
def arm() -> Callable[[np.ndarray], np.ndarray]:
    """The closed form of the arm's joints."""
    return arm_joints


@pytest.fixture
def skeleton(tmp_path: Path) -> Callable[[str], Skeleton]:
    """``skeleton(text)``: the table of a file with this text."""

    def make(text: str) -> Skeleton:
        path = tmp_path / f"skeleton{len(list(tmp_path.iterdir()))}.prototxt"
        path.write_text(text)
        return load(path)

    return make
