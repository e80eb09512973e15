"""handpose/datasets/frames.py"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from handpose.datasets.frames import Frames, examples_of, spread
from handpose.frames.cameras import NYU
from handpose.frames.crops import BACKGROUND
from handpose.synthetic.generator import Generator
from netlib.files.paths import ROOT
from tests.support.hdf5_files import write_hdf5


def made(n: int, dof: np.ndarray | None = None) -> Frames:
    """``n`` frames with two joints, some of them outside the cube."""
    rng = np.random.default_rng(0)
    joints = rng.normal(size=(n, 2, 3))
    uvd = np.array([320.0, 240.0, 700.0]) + rng.normal(size=(n, 3))
    return Frames.of(np.zeros((n, 128, 128)), joints, uvd, NYU, 150.0, np.arange(n), dof)


@pytest.mark.parametrize(
    ("n", "dof"), [(3, None), (3, np.ones((3, 5))), (0, None), (0, np.ones((0, 5)))]
)
def test_columns(n: int, dof: np.ndarray | None) -> None:
    """Arrays have the shapes and types of the files, also for 0 frames."""
    arrays = made(n, dof).arrays()
    shapes = {
        "depth": (1, 128, 128),
        "joint": (6,),
        "dof": (5,),
        "center": (3,),
        "center_uvd": (3,),
    }
    names = [
        "depth",
        "joint",
        *(["dof"] if dof is not None else []),
        "center",
        "center_uvd",
        "index",
        "half_cube",
    ]
    assert list(arrays) == names
    for name, array in arrays.items():
        assert array.shape == (n, *shapes.get(name, ())), name
        assert array.dtype == (np.int64 if name == "index" else np.float32), name


def test_values() -> None:
    """Joints are clipped to the cube, and centres are in mm, too."""
    frames = made(20)
    assert frames.joint.min() == -1
    assert frames.joint.max() == 1
    assert (frames.half_cube == 150).all()
    np.testing.assert_allclose(frames.center, NYU.unproject(frames.center_uvd), atol=1e-3)


def test_all_columns_are_documented() -> None:
    page = (ROOT / "docs" / "data.md").read_text()
    for name, array in Generator().block(0).arrays().items():
        shape = ", ".join(map(str, ("n", *array.shape[1:])))
        assert f"| `{name}` | ({shape}{',' if array.ndim == 1 else ''}) " in page


@pytest.mark.parametrize(
    ("total", "count", "numbers"),
    [(10, 4, [0, 3, 6, 9]), (3, 8, [0, 1, 2]), (5, 1, [0]), (0, 3, [])],
)
def test_spread(total: int, count: int, numbers: list[int]) -> None:
    """The first and the last number are included, and no number occurs twice."""
    assert spread(total, count).tolist() == numbers


def test_frames_of_a_list_come_from_all_its_files(here: Path) -> None:
    """The frames come in order, with joints where the file has them."""
    for name, value in (("a", 0.25), ("b", 0.5)):
        write_hdf5(Path(f"{name}.h5"), depth=np.full((2, 1, 8, 8), value, np.float32))
    with h5py.File(Path("b.h5"), "a") as file:
        file["joint"] = np.arange(12.0).reshape(2, 6)
    Path("list.txt").write_text("a.h5\nb.h5\n")
    (crop, none, first), (other, joints, last) = examples_of(Path("list.txt"), 2)
    assert (first, last) == ("a.h5: frame 0", "b.h5: frame 1")
    assert crop.shape == (8, 8) and none is None
    assert (crop[0, 0], other[0, 0]) == (0.25, 0.5)
    assert joints is not None and joints.tolist() == [6, 7, 8, 9, 10, 11]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_pixels_that_are_not_finite_show_the_background(here: Path, value: float) -> None:
    write_hdf5(Path("a.h5"), depth=np.full((1, 1, 8, 8), value))
    ((crop, _, _),) = examples_of(Path("a.h5"), 1)
    assert (crop == BACKGROUND).all()
