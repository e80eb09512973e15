"""A planar arm with closed-form kinematics, and random bodies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from layers.hand.skeleton import Skeleton, load

# The base moves to (x, y); upper arm (length 2) and forearm (length 1) lie along local x axes
# and turn about z.
ARM = """
    name: "arm"
    dof { name: "x" } dof { name: "y" initial: 0.5 }
    dof { name: "shoulder" initial: 0.25 lower: -1 upper: 1 } dof { name: "elbow" lower: 0 upper: 2.5 }
    joint { name: "hand" parent: "elbow" rotate { axis: Z dof: "elbow" } bone { axis: X length: 1 } }
    joint { name: "elbow" parent: "base" rotate { axis: Z dof: "shoulder" } bone { axis: X length: 2 } }
    joint { name: "base" translate { axis: X dof: "x" } translate { axis: Y dof: "y" } }
"""


def arm_joints(inputs: np.ndarray) -> np.ndarray:
    """The closed form, from inputs (N, 4) to joints (N, 3, 3): hand, elbow, base."""
    x, y, shoulder, elbow = inputs.T
    y, shoulder = y + 0.5, shoulder + 0.25
    base = np.stack([x, y, 0 * x], axis=1)
    upper = 2 * np.stack([np.cos(shoulder), np.sin(shoulder), 0 * x], axis=1)
    fore = np.stack([np.cos(shoulder + elbow), np.sin(shoulder + elbow), 0 * x], axis=1)
    return np.stack([base + upper + fore, base + upper, base], axis=1)


@pytest.fixture(scope="session")
def arm_text() -> str:
    return ARM


@pytest.fixture(scope="session")
def arm() -> Callable[[np.ndarray], np.ndarray]:
    """The closed form of the arm's joints."""
    return arm_joints


def random_body(rng: np.random.Generator) -> str:
    """A skeleton file of 6 joints and 6 DoFs with two roots, children before parents, joints with
    and without a bone, and DoFs that are fixed, drive several joints, translate or rotate.
    """
    axes = ["X", "Y", "Z", "NEG_X", "NEG_Y", "NEG_Z"]
    lines = [
        f'dof {{ name: "d{i}" initial: {rng.normal():.3f} fixed: {"true" if i < 2 else "false"} }}'
        for i in range(6)
    ]
    for i in range(6):
        parts = [f'name: "j{i}"' + (f' parent: "j{rng.integers(i + 1, 6)}"' if i < 4 else "")]
        for kind, most in (("translate", 3), ("rotate", 4)):
            for _ in range(rng.integers(most)):
                parts.append(f'{kind} {{ axis: {rng.choice(axes)} dof: "d{rng.integers(6)}" }}')
        if i % 3:
            parts.append(f"bone {{ axis: {rng.choice(axes)} length: {rng.uniform(0.3, 2):.3f} }}")
        lines.append(f"joint {{ {' '.join(parts)} }}")
    return "\n".join(lines)


@pytest.fixture(params=range(6))
def any_body(request: pytest.FixtureRequest) -> str:
    """The text of a random skeleton file."""
    return random_body(np.random.default_rng(request.param))


@pytest.fixture
def skeleton(tmp_path: Path) -> Callable[[str], Skeleton]:
    """``skeleton(text)`` returns the skeleton of a file with this text."""

    def make(text: str) -> Skeleton:
        path = tmp_path / f"skeleton{len(list(tmp_path.iterdir()))}.prototxt"
        path.write_text(text)
        return load(path)

    return make
