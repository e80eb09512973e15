"""Hand pages in Chromium, which may not fetch anything and must not report any problem."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.output.hand_page.assembly import body, content, page
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from tests.support.chromium_tabs import visits
from tests.support.made_tracks import skeleton_of

# Two bones in a plane, without a surface; one DoF drives two joints, the second with the opposite sign.
ARM = """name: "arm"
dof { name: "x" } dof { name: "shoulder" initial: 0.25 lower: -1 upper: 1 } dof { name: "elbow" lower: 0 upper: 2.5 }
joint { name: "hand" parent: "elbow" rotate { axis: Z dof: "elbow" } bone { axis: X length: 0.5 } }
joint { name: "elbow" parent: "base" rotate { axis: Z dof: "shoulder" } bone { axis: X length: 0.75 } }
joint { name: "base" translate { axis: X dof: "x" } }
joint { name: "other" parent: "base" rotate { axis: NEG_Z dof: "shoulder" } bone { axis: NEG_Y length: 0.5 } }
"""


def any_skeleton(seed: int) -> Skeleton:
    """A random body: joints in any order, all axes and motions, fixed and shared DoFs, a surface."""
    rng = np.random.default_rng(seed)
    axes, K, D = ["X", "Y", "Z", "NEG_X", "NEG_Y", "NEG_Z"], 12, 15

    def axis() -> str:
        return str(rng.choice(axes))

    def joint(name: str, parent: str | None, dofs: list[str]) -> str:
        text = f'name: "{name}"' + (f' parent: "{parent}"' if parent else "")
        for dof in dofs:
            text += f' {rng.choice(["rotate", "rotate", "translate"])} {{ axis: {axis()} dof: "{dof}" }}'
        return f"joint {{ {text} bone {{ axis: {axis()} length: {rng.uniform(-0.2, 0.6):.4f} }} }}"

    def dof(name: str) -> str:
        fixed = " fixed: true" if rng.random() < 0.2 else f" lower: {-rng.random():.3f} upper: {rng.random():.3f}"
        return f'dof {{ name: "{name}" initial: {rng.normal(0, 0.5):.4f}{fixed} }}'

    joints = [
        joint(f"j{i}", f"j{rng.integers(i)}" if i > 1 else None, [f"d{d}" for d in rng.integers(D, size=i % 4)])
        for i in range(K)
    ]
    capsules = [
        f'capsule {{ from: "j{rng.integers(K)}" to: "{to}" radius: {rng.uniform(0.05, 0.2):.3f} radius: 0.08 }}'
        for to in [*(f"j{i}" for i in range(K)), "own"]
    ]
    surface = [dof("own"), joint("own", "j3", ["own", "d2"]), 'offset { joint: "j4" axes: "j2" x: 0.1 z: -0.2 }',
             'offset { joint: "j4" axes: "own" y: 0.1 }', *capsules]
    shuffled = [joints[i] for i in rng.permutation(K)]
    dofs = [dof(f"d{d}") for d in range(D)]
    return skeleton_of("\n".join([f'name: "any {seed}"', *dofs, *shuffled, "flesh {", *surface, "}"]))


def ask(tab: Any, function: str, question: object) -> Any:
    """The result of a JavaScript function; arguments and result are passed as JSON, which is fast."""
    return json.loads(tab.evaluate(f"(text) => JSON.stringify(({function})(JSON.parse(text)))", json.dumps(question)))


@pytest.fixture(scope="module")
def tab(browser: Any, bare: Path) -> Iterator[Any]:
    """One page for tests that only compute."""
    with visits(browser) as opened:
        yield opened(bare)


@pytest.fixture(scope="session")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a page with the NYU hand and one named pose."""
    path = tmp_path_factory.mktemp("page") / "bare.html"
    poses = {"a_pose": {"index_pip_rot_x": -0.5, "thumb_tip_rot_z": 0.25}}
    path.write_text(page("The hand", content([body("hand", skeletons.load(), poses)])), encoding="utf-8")
    return path
