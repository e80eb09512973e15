"""handpose/datasets/published_frames.py; more of it in the tests of the tools that use it"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.nyu import TEST_FRAMES
from handpose.datasets import nyu_files, parts
from handpose.datasets.published_frames import (
    PreparedSplit,
    PublishedFrames,
    read_centers,
    statistics,
)
from handpose.frames import images
from handpose.frames.cameras import NYU
from handpose.frames.images import MISSING, BadFrameError
from netlib.blob import Array
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs
from tests.support.nyu_data_set import write_annotation


def frames(**changes: object) -> PublishedFrames:
    """Two frames of a plate."""
    facts: dict[str, object] = {
        "split": "test",
        "files": [Path("0.png"), Path("1.png")],
        "center_uvd": np.array([[320.0, 240, 800], [300, 200, 700]]),
        "joints": np.zeros((2, 4, 3)) + (0, 0, 800),
        "cube_mm": np.array([300.0, 261.0]),
        "camera": NYU,
        "read": lambda path: np.full((480, 640), 780.0),
        "made_from": "plates",
        "centre": "middle",
    }
    return PublishedFrames(**{**facts, **changes})  # type: ignore[arg-type]


def test_crops() -> None:
    """A good frame becomes a labelled crop, and each kind of bad frame is reported."""
    found, bad = frames().crops(0, 2)
    assert not bad
    assert_allclose(found.depth[0, 0, 64, 64], -20 / 150, rtol=1e-6)
    assert_array_equal(found.joint[0], 0)
    assert found.joint[1].max() == pytest.approx(100 / 130.5)
    nan = np.zeros((2, 4, 3)) * np.nan
    for changes, kind in (
        ({"joints": nan}, images.UNLABELLED),
        ({"center_uvd": np.array([[320, 240, 0.0]] * 2)}, images.UNLABELLED),
        ({"center_uvd": np.array([[9999, 240, 800.0]] * 2)}, images.OUTSIDE),
        ({"read": lambda path: np.full((480, 640), 2000.0)}, images.EMPTY),
        ({"read": lambda path: np.zeros((480, 640))}, images.EMPTY),
        ({"read": lambda path: np.full((640, 480), 780.0)}, images.WRONG_SIZE),
    ):
        found, bad = frames(**changes).crops(0, 2)
        assert [(i, error.kind) for i, error in bad] == [(0, kind), (1, kind)]
        assert len(found) == 0
        assert found.depth.shape == (0, 1, 128, 128)
        assert found.joint.shape == (0, 12)


def test_recipe(tmp_path: Path) -> None:
    """A recipe depends on the frames, the labels, the centres, the cube and the size
    of the images.
    """
    first = frames().recipe(0, 2)
    some = tmp_path / "0.png"
    some.write_text("image")
    changes: list[dict[str, object]] = [
        {"center_uvd": np.zeros((2, 3))},
        {"joints": np.ones((2, 4, 3))},
        {"cube_mm": np.full(2, 300.0)},
        {"centre": "elsewhere"},
        {"files": [some, Path("1.png")]},
    ]
    assert frames().recipe(0, 2) == first
    found = [first, frames().recipe(0, 1), *(frames(**each).recipe(0, 2) for each in changes)]
    assert len({json.dumps(recipe) for recipe in found}) == 7


def test_a_file_of_centres(here: Path) -> None:
    Path("centers.txt").write_text("0 1 2\n3, 4, 5\n")
    centers, what = read_centers(Path("centers.txt"), 2)
    assert_array_equal(centers, np.arange(6.0).reshape(2, 3))
    assert what == "centres of centers.txt"


@bad_inputs(
    DataError,
    {
        "1 2\n3 4\n": "...centers.txt: found centres of shape (2, 2), expected (2, 3)...",
        "1 2 3\n3 4\n": "...centers.txt: cannot read the centres: ...at row 2...; expected u v d for ...",
        "u v d\n": "...centers.txt: cannot read the centres: could not convert string 'u' ...",
        "1 2 3\n": "...expected (2, 3)...",
    },
)
def test_wrong_centres(here: Path, given: str, rejected: Any) -> None:
    Path("centers.txt").write_text(given)
    with rejected:
        read_centers("centers.txt", 2)


def test_statistics() -> None:
    report = statistics(frames(), [0, 1])
    assert "crops about the middle, cube 261 mm (1 frames) and 300 mm (1 frames)" in report
    assert "0.0% of the frames have a joint outside the cube" in report


def test_statistics_of_the_real_annotation(nyu_data: Path, here: Path) -> None:
    """A fifth of NYU's test frames have an annotated joint outside the cube about joint 34."""
    uvd = np.load(nyu_data / "test_joint_uvd.npz")["joint_uvd"].astype(float)
    Path("test").mkdir()
    write_annotation(Path("test", nyu_files.ANNOTATION), NYU.unproject(uvd))
    report = statistics(nyu_files.read_split(here, "test"), range(TEST_FRAMES))
    assert "cube 261 mm (5812 frames) and 300 mm (2440 frames); 19.2% of the frames" in report


def split_of(folder: Path, bad: range, count: int = 7) -> PublishedFrames:
    """Frames of a plate; those in ``bad`` cannot be read."""

    def read(path: Path) -> Array:
        if int(path.stem) in bad:
            raise BadFrameError(path, MISSING)
        return np.full((NYU.height, NYU.width), 780.0)

    return frames(
        files=[folder / f"{i}.png" for i in range(count)],
        center_uvd=np.tile([320.0, 240, 800], (count, 1)),
        joints=np.zeros((count, 4, 3)) + (0, 0, 800),
        cube_mm=np.full(count, 300.0),
        read=read,
    )


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts have 3 frames per file."""
    monkeypatch.setattr(parts, "FRAMES_PER_FILE", 3)


@pytest.mark.usefixtures("small")
def test_bad_frames_are_named_and_left_out(tmp_path: Path) -> None:
    """A part without good frames is not listed; a second run writes nothing and gives
    the same report.
    """
    reports: list[str] = []
    for missing in (3, 0):
        split = PreparedSplit(split_of(tmp_path, range(2, 6)), tmp_path)
        assert [len(split.parts), len(split.missing)] == [3, missing]
        split.write(2, lambda count: None, lambda i, error: None)
        split.write_list()
        assert (split.index, split.made) == ([0, 1, 6], missing)
        assert split.list.read_text() == f"{tmp_path}/test_000.h5\n{tmp_path}/test_002.h5\n"
        assert [line[:8] for line in split.bad.read_text().splitlines()] == [
            f"frame {i}:" for i in range(2, 6)
        ]
        reports.append(split.report())
    assert reports[0] == reports[1]
    assert reports[0].startswith(
        "test: 3 frames (plates), 4 bad frames left out: 4 no such file\ntest: crops about the "
    )
