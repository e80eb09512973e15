"""handpose/nyu.py"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from handpose import nyu
from layers import kinematics
from netlib.errors import DataError


def test_joints_of_the_model() -> None:
    """Every model joint has an annotation of its own, and the evaluation joints are the published ones."""
    assert len(set(nyu.ANNOTATION_OF_JOINT)) == 31 == len(kinematics.load().joint_names)
    assert nyu.CENTER_JOINT not in nyu.ANNOTATION_OF_JOINT
    assert nyu.EVALUATION_JOINTS == (0, 3, 5, 8, 10, 13, 15, 18, 30, 29, 28, 25, 26, 24)


def test_annotations_are_where_the_names_say(nyu_data: Path) -> None:
    """Annotated fingertips are far from the annotated palm, knuckles are near."""
    uvd = np.load(nyu_data / "test_joint_uvd.npz")["joint_uvd"][:, list(nyu.ANNOTATION_OF_JOINT)]
    names = kinematics.load().joint_names
    from_palm = np.median(np.linalg.norm(uvd - uvd[:, [names.index("palm")]], axis=2), axis=0)
    tips = [from_palm[j] for j, name in enumerate(names) if name.endswith("_tip")]
    knuckles = [from_palm[j] for j, name in enumerate(names) if name.endswith("_mcp")]
    assert min(tips) > max(knuckles)


def test_cubes() -> None:
    """The second subject, from test frame 2440 on, has the smaller cube."""
    np.testing.assert_allclose(nyu.cube_of_test_frame([0, 2439, 2440, 8251]), [300, 300, 261, 261])


def test_a_part_of_the_test_set_has_one_size() -> None:
    """And whoever uses it can say so."""
    np.testing.assert_allclose(nyu.half_cubes(nyu.TEST_FRAMES)[[0, 8251]], [150, 130.5])
    assert nyu.one_size_for_all(nyu.TEST_FRAMES) == ""
    np.testing.assert_allclose(nyu.half_cubes(3), 150)
    assert nyu.one_size_for_all(3).startswith("warning: 3 of 8252 test frames; the first subject's size of hand")


def test_depth_is_unpacked(tmp_path: Path) -> None:
    """Green counts 256 mm, blue 1 mm, red nothing."""
    cv2.imwrite(str(tmp_path / "depth.png"), np.array([[[5, 3, 9], [0, 0, 0]]], dtype=np.uint8))
    np.testing.assert_array_equal(nyu.read_nyu_depth(tmp_path / "depth.png"), [[773, 0]])


def test_unreadable_frames(tmp_path: Path) -> None:
    """A missing file, one that is no image, and a grey image are told apart."""
    (tmp_path / "text.png").write_text("text")
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((2, 2), dtype=np.uint16))
    for name, message in (("no.png", "no such file"), ("text.png", "no PNG"), ("grey.png", "found uint16")):
        with pytest.raises(DataError, match=message):
            nyu.read_nyu_depth(tmp_path / name)
