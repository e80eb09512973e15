"""handpose/datasets/nyu_files.py: depth, labels, and what is wrong with a copy of the data set"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from handpose.body.nyu import frame_name
from handpose.datasets import nyu_files
from handpose.frames.cameras import NYU
from netlib.errors import DataError
from tests.support.nyu_data_set import pack_depth, write_annotation


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
        DataError,
        match=r"grey\.png: wrong size or type of image \(found uint16 of shape \(2, 2\), ",
    ):
        nyu_files.read_nyu_depth(tmp_path / "grey.png")


UVD = np.array([320.0, 240.0, 800.0]) + np.random.default_rng(0).normal(0, 5, (8253, 36, 3))
XYZ = NYU.unproject(UVD[:20])


def write(folder: Path, count: int) -> Path:
    """Write the labels of some frames, and the first frame; returns the file of labels."""
    folder.mkdir()
    write_annotation(folder / nyu_files.ANNOTATION, NYU.unproject(UVD[:count]))
    cv2.imwrite(str(folder / frame_name(0)), pack_depth(np.full((480, 640), 800)))
    return folder / nyu_files.ANNOTATION


@pytest.mark.parametrize(("count", "fatal"), [(100, False), (8253, True)])
def test_another_number_of_frames(tmp_path: Path, count: int, fatal: bool) -> None:
    path = write(tmp_path / "test", count)
    missing = f"{count - 1} of {count} depth frames are missing, the first is {path.with_name('depth_1_0000002.png')}"
    assert flaws(tmp_path) == [
        (f"{path}: {count} labelled frames, the whole test set has 8252", fatal),
        (f"{path.parent}: {missing}", False),
    ]


def test_folders_without_the_data_set_are_reported(tmp_path: Path) -> None:
    assert flaws(tmp_path / "no") == [(f"{tmp_path}/no: no such folder", True)]
    expected = f"{tmp_path}: no folder 'test', which holds depth_1_0000001.png ... and joint_data.mat; found "
    assert flaws(tmp_path) == [(f"{expected}nothing", True)]
    for name in "jihgfedcba":
        (tmp_path / name).touch()
    assert flaws(tmp_path) == [(f"{expected}a, b, c, d, e, f, g, h and 2 more", True)]


def write_matlab(path: Path, version: str = "5", **variables: np.ndarray) -> None:
    scipy.io.savemat(path, variables, format=version)


@pytest.mark.parametrize(
    ("damage", "reported"),
    [
        (lambda path: path.unlink(), "no such file; it holds the joints"),
        (
            lambda path: path.write_bytes(path.read_bytes()[:-1000]),
            "not a readable MATLAB file, perhaps truncated",
        ),
        (lambda path: path.write_text("u v d " * 100), "not a readable MATLAB file"),
        (
            lambda path: write_matlab(path, "4", joint_uvd=UVD[:20][0], joint_xyz=XYZ[0]),
            "version 4, or none; expected version 5",
        ),
        (
            lambda path: write_matlab(path, pred_joint_uvconf=XYZ[None]),
            "no variable 'joint_uvd'; it has pred_joint_uvconf",
        ),
        (
            lambda path: write_matlab(
                path, joint_uvd=UVD[:20][None, :, :14], joint_xyz=XYZ[None, :, :14]
            ),
            "(1, 20, 14, 3), expected numbers (cameras, frames, 36, 3)",
        ),
        (
            lambda path: write_matlab(
                path, joint_uvd=UVD[:20][None], joint_xyz=XYZ[None] * (1, -1, 1)
            ),
            "joint_xyz is not where joint_uvd is, off by x 0, ",
        ),
    ],
)
def test_damaged_labels(tmp_path: Path, damage: Callable[[Path], object], reported: str) -> None:
    path = write(tmp_path / "test", 20)
    damage(path)
    ((line, fatal),) = flaws(tmp_path)
    assert reported in line and line.startswith(f"{path}: ") and fatal
