"""handpose/body/nyu.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from handpose.body import nyu
from layers.hand import skeleton


def test_joints_of_the_model() -> None:
    """Every model joint has an annotation of its own, and the evaluation joints are the
    published ones.
    """
    assert len(set(nyu.ANNOTATION_OF_JOINT)) == 31 == len(skeleton.load().joint_names)
    assert nyu.CENTER_JOINT not in nyu.ANNOTATION_OF_JOINT
    assert nyu.EVALUATION_JOINTS == (0, 3, 5, 8, 10, 13, 15, 18, 30, 29, 28, 25, 26, 24)


def test_annotations_are_where_the_names_say(nyu_data: Path) -> None:
    """Annotated fingertips are far from the annotated palm, knuckles are near."""
    uvd = np.load(nyu_data / "test_joint_uvd.npz")["joint_uvd"][:, list(nyu.ANNOTATION_OF_JOINT)]
    names = skeleton.load().joint_names
    from_palm = np.median(np.linalg.norm(uvd - uvd[:, [names.index("palm")]], axis=2), axis=0)
    tips = [from_palm[j] for j, name in enumerate(names) if name.endswith("_tip")]
    knuckles = [from_palm[j] for j, name in enumerate(names) if name.endswith("_mcp")]
    assert min(tips) > max(knuckles)


def test_cubes() -> None:
    """The second subject, from test frame 2440 on, has the smaller cube; a part of the test set has
    the first one's.
    """
    assert_allclose(nyu.cube_of_test_frame([0, 2439, 2440, 8251]), [300, 300, 261, 261])
    assert_allclose(nyu.half_cubes(nyu.TEST_FRAMES)[[0, 8251]], [150, 130.5])
    assert nyu.one_size_for_all(nyu.TEST_FRAMES) == ""
    assert_allclose(nyu.half_cubes(3), 150)
    assert nyu.one_size_for_all(3).startswith(
        "warning: 3 of 8252 test frames; the first subject's size of hand"
    )
