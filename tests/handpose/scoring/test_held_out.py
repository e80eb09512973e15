"""A net's predictions over a test set, and their figures."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib
from handpose.scoring import held_out
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError, NetlibError
from netlib.proto import prototxt

NET = """
layer {{
  name: "data" type: "HDF5Data" top: "x" top: "joint"
  hdf5_data_param {{ source: "{list}" batch_size: {batch} {extra} }}
}}
layer {{ name: "hand" type: "HandModel" bottom: "x" top: "pred" }}
layer {{ name: "loss" type: "EuclideanLoss" bottom: "pred" bottom: "joint" top: "loss" }}
"""


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Seven frames whose inputs are the pose itself, and whose joints are 10 mm away from it."""
    x = np.random.default_rng(0).normal(0, 0.2, (7, 47)).astype(np.float32)
    joint = kinematics_of(skeleton.load()).joints(x) + np.array([10 / 150, 0, 0])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"], file["joint"] = x, joint.reshape(7, 93).astype(np.float32)
        file["half_cube"] = np.full(7, 150.0)
    (tmp_path / "list.txt").write_text("a.h5\n")
    return tmp_path


def net_of(folder: Path, batch: int = 7, extra: str = "") -> netlib.Net:
    text = NET.format(list=folder / "list.txt", batch=batch, extra=extra)
    return netlib.Net(prototxt.parse(text), netlib.TEST)


@pytest.mark.parametrize("batch", [1, 3, 7, 50])
def test_every_frame_counts_once(frames: Path, batch: int) -> None:
    """For every batch size the error is 10 mm, and the loss is that of the seven frames."""
    tracked: list[int] = []
    found = held_out.predict_all(net_of(frames, batch), progress=tracked.append)
    figures = held_out.figures_of(found, skeleton.load())
    assert figures["error_mm"] == pytest.approx(10, rel=1e-5)
    assert figures["error_14_mm"] == pytest.approx(10, rel=1e-5)
    assert (figures["within_20_mm"], figures["out_of_limits"] > 0) == (1.0, True)
    assert found.outputs["loss"] == pytest.approx(31 * (10 / 150) ** 2 / 2, rel=1e-5)
    assert tracked[-1] == 7
    assert found.skeleton is not None and np.allclose(found.skeleton, found.joints)


def test_a_second_run_begins_at_the_first_frame(frames: Path) -> None:
    """A second run of the same net starts at the first frame again."""
    net = net_of(frames, 3)
    first, second = held_out.predict_all(net), held_out.predict_all(net)
    assert np.array_equal(first.joints, second.joints)


def test_a_half_cube_that_gives_no_millimetres(frames: Path) -> None:
    """A half-cube of NaN raises an error."""
    with h5py.File(frames / "a.h5", "a") as file:
        file["half_cube"][2] = np.nan
    with pytest.raises(DataError, match=r"a\.h5: data set 'half_cube' is nan in frame 2"):
        held_out.predict_all(net_of(frames))


def test_joints_that_are_not_finite(frames: Path) -> None:
    """The error names the file and the frame within it."""
    shutil.copy(frames / "a.h5", frames / "b.h5")
    (frames / "list.txt").write_text("a.h5\nb.h5\n")
    with h5py.File(frames / "b.h5", "a") as file:
        file["joint"][3, 5] = np.nan
    with pytest.raises(DataError, match=r"b\.h5: the annotated joints of frame 3 are not finite \(1 such frames\)"):
        held_out.predict_all(net_of(frames))


def test_predictions_that_are_not_finite(frames: Path) -> None:
    """The error names the frame."""
    with h5py.File(frames / "a.h5", "a") as file:
        file["x"][3, 5] = np.nan
    with pytest.raises(DataError, match="the predicted joints of frame 3 are not finite"):
        held_out.figures_of(held_out.predict_all(net_of(frames)), skeleton.load())


def test_a_shuffled_test_set(frames: Path) -> None:
    """A shuffled test set raises an error, because half-cubes are stored in the order of frames."""
    with pytest.raises(NetlibError, match="layer 'data' shuffles its frames"):
        held_out.predict_all(net_of(frames, extra="shuffle: true"))
