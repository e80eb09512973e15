"""handpose/datasets/nyu_files.py: depth, labels, and what is wrong with a copy of the data set"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from handpose.body.nyu import frame_name
from handpose.datasets import nyu_files
from handpose.frames.cameras import NYU
from netlib.errors import DataError
from tests.handpose.datasets.nyu_frames import hand, write_frame, write_labels


def flaws(root: Path, split: str = "test") -> list[tuple[str, bool]]:
    """The problems of a split, and whether each is fatal."""
    return [(flaw.text, flaw.fatal) for flaw in nyu_files.check_split(root, split)[1]]


def test_depth_is_unpacked(tmp_path: Path) -> None:
    """Green counts units of 256 mm, blue 1 mm; red is ignored."""
    cv2.imwrite(str(tmp_path / "depth.png"), np.array([[[5, 3, 9], [0, 0, 0]]], dtype=np.uint8))
    np.testing.assert_array_equal(nyu_files.read_nyu_depth(tmp_path / "depth.png"), [[773, 0]])


def test_a_grey_image(tmp_path: Path) -> None:
    """A grey image raises an error, because the depth is in two channels of a colour image."""
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((2, 2), dtype=np.uint16))
    with pytest.raises(
        DataError, match=r"grey\.png: wrong size or type of image \(found uint16 of shape \(2, 2\), exp"
    ):
        nyu_files.read_nyu_depth(tmp_path / "grey.png")


@pytest.mark.parametrize(
    ("count", "reported", "fatal"),
    [
        (100, "100 labelled frames, the whole test set has 8252", False),
        (8253, "8253 labelled frames, the whole test set has 8252", True),
    ],
)
def test_another_number_of_frames(tmp_path: Path, count: int, reported: str, fatal: bool) -> None:
    write_labels(tmp_path / "test", hand(count))
    write_frame(tmp_path / "test" / frame_name(0), np.full((480, 640), 800))
    (number, is_fatal), missing = flaws(tmp_path)
    assert reported in number and is_fatal == fatal
    expected = f"{count - 1} of {count} depth frames are missing, the first is depth_1_0000002.png"
    assert missing == (f"{tmp_path}/test: {expected}", False)


def test_something_else_than_the_data_set(tmp_path: Path) -> None:
    expected = f"{tmp_path}: no folder 'test', which holds depth_1_0000001.png ... and joint_data.mat; found "
    assert flaws(tmp_path) == [(f"{expected}nothing", True)]
    for name in "hgfedcba":
        (tmp_path / name).touch()
    assert flaws(tmp_path) == [(f"{expected}a, b, c, d, e, f ...", True)]


def test_no_folder(tmp_path: Path) -> None:
    assert flaws(tmp_path / "no") == [(f"{tmp_path}/no: no such folder", True)]


def test_other_images_than_depth(tmp_path: Path) -> None:
    write_labels(tmp_path / "test", hand(2440))
    (tmp_path / "test" / "rgb_1_0000001.png").touch()
    line = "no depth frames of camera 1 such as depth_1_0000001.png; found rgb_1_0000001.png"
    assert flaws(tmp_path)[0] == (f"{tmp_path}/test: {line}", True)


def damage_labels(path: Path, how: str) -> None:
    joints = nyu_files.read_annotation(path).xyz
    uvd = NYU.project(joints)
    if how == "absent":
        path.unlink()
    elif how == "truncated":
        path.write_bytes(path.read_bytes()[:-1000])
    elif how == "text":
        path.write_text("u v d " * 100)
    elif how == "version 4":
        scipy.io.savemat(path, {"joint_uvd": uvd[0], "joint_xyz": joints[0]}, format="4")
    elif how == "predictions":
        scipy.io.savemat(path, {"pred_joint_uvconf": uvd[None]})
    elif how == "14 joints":
        scipy.io.savemat(path, {"joint_uvd": uvd[None, :, :14], "joint_xyz": joints[None, :, :14]})
    elif how == "y down":
        scipy.io.savemat(path, {"joint_uvd": uvd[None], "joint_xyz": joints[None] * (1, -1, 1)})


@pytest.mark.parametrize(
    ("how", "reported"),
    [
        ("absent", "no such file; it holds the joints"),
        ("truncated", "not a readable MATLAB file, perhaps truncated"),
        ("text", "not a readable MATLAB file"),
        ("version 4", "version 4, or none; expected version 5"),
        ("predictions", "no variable 'joint_uvd'; it has pred_joint_uvconf"),
        ("14 joints", "(1, 20, 14, 3), expected numbers (cameras, frames, 36, 3)"),
        ("y down", "joint_xyz is not where joint_uvd is, off by x 0, "),
    ],
)
def test_damaged_labels(tmp_path: Path, how: str, reported: str) -> None:
    write_labels(tmp_path / "test", hand(20))
    write_frame(tmp_path / "test" / frame_name(0), np.full((480, 640), 800))
    damage_labels(tmp_path / "test" / nyu_files.ANNOTATION, how)
    ((line, fatal),) = flaws(tmp_path)
    assert reported in line and line.startswith(f"{tmp_path / 'test' / nyu_files.ANNOTATION}: ") and fatal
