"""Hand pages in Chromium, which may not fetch anything and must not report any problem."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.output.hand_page.assembly import page
from handpose.output.hand_page.values import body
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import text_of
from tests.support.chromium_tabs import visits
from tests.support.made_tracks import any_skeleton, skeleton_of

# Two bones in a plane, without a surface; one DoF drives two joints, the second with the
# opposite sign.
ARM = """name: "arm"
dof { name: "x" } dof { name: "shoulder" initial: 0.25 lower: -1 upper: 1 } dof { name: "elbow" lower: 0 upper: 2.5 }
joint { name: "hand" parent: "elbow" rotate { axis: Z dof: "elbow" } bone { axis: X length: 0.5 } }
joint { name: "elbow" parent: "base" rotate { axis: Z dof: "shoulder" } bone { axis: X length: 0.75 } }
joint { name: "base" translate { axis: X dof: "x" } }
joint { name: "other" parent: "base" rotate { axis: NEG_Z dof: "shoulder" } bone { axis: NEG_Y length: 0.5 } }
"""


def any_body(seed: int) -> Skeleton:
    """A random skeleton with a surface, which has a joint, a DoF and offsets of its own."""
    rng, plain = np.random.default_rng(seed), any_skeleton(seed, 12)
    names = [*plain.joint_names, "own"]
    starts, radii = rng.choice(names[:-1], len(names)), rng.uniform(0.05, 0.2, len(names))
    capsules = [
        f'capsule {{ from: "{start}" to: "{end}" radius: {radius:.3f} radius: 0.08 }}'
        for start, end, radius in zip(starts, names, radii)
    ]
    flesh = f"""flesh {{ dof {{ name: "own" initial: 0.3 lower: -1 upper: 1 }}
      joint {{ name: "own" parent: "{names[3]}" rotate {{ axis: NEG_Y dof: "own" }} bone {{ axis: X length: 0.4 }} }}
      offset {{ joint: "own" axes: "{names[2]}" x: 0.1 z: -0.2 }} offset {{ joint: "{names[4]}" axes: "own" y: 0.1 }}
      """
    return skeleton_of("\n".join([text_of(plain.param, plain.name, ""), flesh, *capsules, "}"]))


def ask(tab: Any, function: str, question: object) -> Any:
    """The result of a JavaScript function; arguments and result are passed as JSON,
    which is fast.
    """
    return json.loads(
        tab.evaluate(
            f"(text) => JSON.stringify(({function})(JSON.parse(text)))", json.dumps(question)
        )
    )


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
    path.write_text(page("The hand", [body("hand", skeletons.load(), poses)]), encoding="utf-8")
    return path
