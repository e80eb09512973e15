"""Bodies, joints and crops that cannot be fitted, and the line of each error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.fit.body import CapsuleModel, RootMotion
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.joints.fit_joints import fit_joints
from handpose.fit.observation import HandCrops, observe
from handpose.fit.search import turned_back
from handpose.fit.settings import SearchSettings
from handpose.frames.cameras import KINECT2
from layers.hand import skeleton
from netlib.errors import DataError, NetlibError
from tests.handpose.body.test_surface_model import ARM
from tests.handpose.fit import test_root_motion
from tests.handpose.fit.conftest import Scene
from tests.handpose.fit.test_body import body
from tests.handpose.fit.test_residuals import PIPE
from tests.support.bad_input import bad_inputs

FAST, ACCURATE = SearchSettings().plans.values()
NYU = skeleton.load()  # joints that are fitted are NYU's labels
ROOT = (
    "skeleton 'made up': its root does not translate along x, y, z and turn about three axes, by "
    "a free DoF each, ..."
)
PARTS = (
    ("X Y", "Z X Y"),
    ("X Y Y", "Z X Y"),
    ("X Y Z", "Z X"),
    ("X Y Z", "Z X Z"),
    ("X Y Z", "Z X Y", "fixed: true"),
    ("X Y Z", "Z X Y", "", "abb"),
)


def poses(*shape: int, value: float = 0, joints: Any = None) -> Callable[[], object]:
    return lambda: fit_joints(NYU, np.full(shape, value), joints)


@bad_inputs(
    DataError,
    {
        **{
            f"root {parts}": (
                lambda parts=parts: RootMotion(test_root_motion.body(*parts)),
                NetlibError,
                ROOT,
            )
            for parts in PARTS
        },  # two slides or turns, one twice, a fixed DoF, one DoF for two
        "a body that cannot turn": (
            lambda: turned_back(body(PIPE % (1, 1)), np.zeros((1, 4)), 1),
            NetlibError,
            ROOT.replace("made up", "pipe"),
        ),
        **{
            name: (
                lambda text=text: body(text),
                NetlibError,
                "skeleton 'arm': expected one root, without a bone, that alone translates",
            )
            for name, text in (
                (
                    "slides",
                    ARM.replace(
                        '"end" parent: "root"',
                        '"end" parent: "root" translate { axis: Y dof: "x" }',
                    ),
                ),
                (
                    "two roots",
                    ARM.replace('joint { name: "end" parent: "root"', 'joint { name: "end"'),
                ),
            )
        },
        "one crop": (
            lambda: observe(HandCrops(np.zeros((128, 128)), [[1, 2, 3]], KINECT2, 300.0), 400, 3.0),
            "crops of shape (128, 128), expected (N, size, size)",
        ),
        "13 joints": (
            poses(2, 13, 3, joints=EVALUATION_JOINTS),
            "joints of shape (2, 13, 3), expected (N, 14, 3)",
        ),
        "no joint": (poses(2, 31, 3, value=np.nan), "frame 0 has no known joint (2 such frames)"),
        "an infinite joint": (poses(2, 31, 3, value=np.inf), "frame 0 has an infinite joint"),
    },
)
def test_unsuitable_bodies_and_joints_are_rejected(
    given: Callable[[], object], rejected: Any
) -> None:
    """Bodies with other roots, and joints that are too few, unknown or not finite,
    raise an error.
    """
    with rejected:
        given()


@bad_inputs(
    DataError,
    {
        "starts": (
            lambda fit, x, scene: fit.fit(scene.seen, [x], ACCURATE),
            "1 starts, expected 4 for the plan 'accurate'",
        ),
        "frames": (
            lambda fit, x, scene: fit.fit(scene.seen, [x[:11]], FAST),
            "starts of 11 frames for 12 crops",
        ),
    },
)
def test_mistakes(
    model: CapsuleModel, scene: Scene, given: Callable[..., object], rejected: Any
) -> None:
    """The number of starts must match the quarter turns, the number of frames the crops."""
    with rejected:
        given(DepthFitter(model), scene.truth, scene)
