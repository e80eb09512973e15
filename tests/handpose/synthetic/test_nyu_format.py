"""handpose/synthetic/nyu_format.py; more of it in the tests of tools/make_synthetic.py and of tools/prepare_nyu.py"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from handpose.frames.crops import crop, window
from handpose.synthetic.generator import Generator, Split
from handpose.synthetic.nyu_format import RawDataSet, whole_image
from handpose.synthetic.recipes import recipe
from netlib.errors import DataError

COUNTS: dict[Split, int] = {"train": 3, "test": 2}


def test_the_crop_of_the_image_is_the_crop() -> None:
    """The crop of the image equals the frame's crop to half a mm, because the image has whole mm."""
    generator = Generator(seed=1)
    scene = generator.scene(0)
    for n in range(8):
        image = whole_image(scene, n)
        assert image.shape == (480, 640) and np.array_equal(image, np.rint(image))
        again = crop(image, scene.center_uvd[n], scene.cube_mm)
        assert np.abs(again - scene.depth[n]).max() * scene.cube_mm / 2 <= 0.5 + 1e-3


def test_the_image_of_a_hand_is_solid() -> None:
    """The hand has no grid of holes, although the crop uses every other pixel."""
    scene = Generator(seed=1).scene(0)
    for n in range(5):
        seen = (whole_image(scene, n) > 0).astype(np.uint8)
        closed = cv2.morphologyEx(seen, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        assert (closed > seen).sum() < 0.03 * seen.sum()


@pytest.mark.parametrize(("u", "v"), [(8, 240), (320, 8), (11, 11), (14, 23)])
def test_a_hand_over_the_upper_or_left_border(u: float, v: float) -> None:
    """The crop's part within the image is restored, including the image's first column and row."""
    generator = Generator(seed=1)
    scene = generator.scene(0)
    center = np.array([[u, v, 800.0]])
    image = whole_image(scene._replace(center_uvd=center, depth=np.full_like(scene.depth[:1], 0.25)), 0)
    picked = window(center, scene.cube_mm)
    inside = (picked.rows[0, :, None] >= 0) & (picked.columns[0] >= 0)
    assert inside.any() and not inside.all()
    again = crop(image, center[0], scene.cube_mm)
    assert np.abs(again[inside] - 0.25).max() * scene.cube_mm / 2 <= 0.5 + 1e-3


def test_whole_splits_are_kept(tmp_path: Path) -> None:
    """Complete splits of an interrupted run are kept, and ``advance`` counts every frame."""
    reported: list[int] = []

    def advance(count: int) -> None:
        reported.append(count)
        if sum(reported) == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        RawDataSet(tmp_path, 0, COUNTS).write(1, advance)
    data = RawDataSet(tmp_path, 0, COUNTS)
    assert (reported, data.missing_frames, data.is_whole) == ([3, 2], 2, False)
    data.write(1, lambda count: None)
    assert RawDataSet(tmp_path, 0, COUNTS).is_whole
    assert RawDataSet(tmp_path, 0, COUNTS, force=True).missing_frames == 5
    assert RawDataSet(tmp_path, 1, COUNTS).missing_frames == 5


def test_a_person_with_another_cube_is_refused(tmp_path: Path) -> None:
    """A recipe with a second cube size raises an error, because the format stores no cubes."""
    with pytest.raises(
        DataError, match="holds no cubes, they are taken for 300 mm; this recipe also has one of 261 mm"
    ):
        RawDataSet(tmp_path, 0, COUNTS, recipe("one_hand"))
