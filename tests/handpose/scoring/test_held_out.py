"""handpose/scoring/held_out.py"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import netlib
from handpose.frames.cameras import NYU
from handpose.scoring import held_out
from handpose.scoring.held_out import centers_of, crops_of, data_layer, deploy_of
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError, NetlibError, WeightsError
from netlib.net import Net
from netlib.proto import prototxt
from tests.support.bad_input import bad_inputs
from tests.support.hdf5_files import write_hdf5

NET = """
layer {{
  name: "data" type: "HDF5Data" top: "x" top: "joint"
  hdf5_data_param {{ source: "{list}" batch_size: {batch} {extra} }}
}}
layer {{ name: "hand" type: "HandModel" bottom: "x" top: "pred" }}
layer {{ name: "loss" type: "EuclideanLoss" bottom: "pred" bottom: "joint" top: "loss" }}
"""


@pytest.fixture
def frames(tmp_path: Path, rng: np.random.Generator) -> Path:
    """Seven frames whose inputs are the pose itself, and whose joints are 10 mm away from it."""
    x = rng.normal(0, 0.2, (7, 47)).astype(np.float32)
    joint = kinematics_of(skeleton.load()).joints(x) + np.array([10 / 150, 0, 0])
    write_hdf5(
        tmp_path / "a.h5",
        x=x,
        joint=joint.reshape(7, 93).astype(np.float32),
        half_cube=np.full(7, 150.0),
    )
    (tmp_path / "list.txt").write_text("a.h5\n")
    return tmp_path


def net_of(folder: Path, batch: int = 7, extra: str = "") -> netlib.Net:
    text = NET.format(list=folder / "list.txt", batch=batch, extra=extra)
    return netlib.Net(prototxt.parse(text), netlib.TEST)


@pytest.mark.parametrize("batch", [1, 3, 7, 50])
def test_every_frame_counts_once(frames: Path, batch: int) -> None:
    """For every batch size the error is 10 mm, and the loss that of the seven frames; a second
    run begins anew.
    """
    tracked: list[int] = []
    net = net_of(frames, batch)
    found = held_out.predict_all(net, progress=tracked.append)
    figures = held_out.figures_of(found, skeleton.load())
    assert figures["error_mm"] == pytest.approx(10, rel=1e-5)
    assert figures["error_14_mm"] == pytest.approx(10, rel=1e-5)
    assert (figures["within_20_mm"], figures["out_of_limits"] > 0) == (1.0, True)
    assert found.outputs["loss"] == pytest.approx(31 * (10 / 150) ** 2 / 2, rel=1e-5)
    assert tracked[-1] == 7
    assert found.skeleton is not None and np.allclose(found.skeleton, found.joints)
    assert np.array_equal(held_out.predict_all(net).joints, found.joints)


def predict(folder: Path, name: str = "", at: int = 0, extra: str = "") -> object:
    """Figures of two files of frames; one has a NaN in row 2 or 3 of a data set."""
    shutil.copy(folder / "a.h5", folder / "b.h5")
    (folder / "list.txt").write_text("a.h5\nb.h5\n")
    with h5py.File(folder / "b.h5", "a") as file:
        if name:
            file[name][at] = np.nan
    return held_out.figures_of(held_out.predict_all(net_of(folder, extra=extra)), skeleton.load())


@bad_inputs(
    DataError,
    {
        "half_cube": (
            lambda at: predict(at, "half_cube", 2),
            "...b.h5: data set 'half_cube' is nan in frame 2 ..., expected mm, 25 to 5000",
        ),
        "joint": (
            lambda at: predict(at, "joint", 3),
            "...b.h5: the annotated joints of frame 3 are not finite (1 such frames)",
        ),
        "x": (
            lambda at: predict(at, "x", 3),
            "the predicted joints of frame 10 are not finite (1 such frames)",
        ),
        "shuffle": (
            lambda at: predict(at, extra="shuffle: true"),
            NetlibError,
            "<net>: layer 'data' shuffles its frames; a test set is read in order",
        ),
    },
)
def test_frames_that_cannot_be_judged(
    frames: Path, given: Callable[[Path], object], rejected: Any
) -> None:
    """Values that are not finite are reported with the file and frame; half-cubes are in the
    order of frames.
    """
    with rejected:
        given(frames)


LEARNED = (
    'layer {{ name: "{0}" type: "InnerProduct" bottom: "{1}" top: "{0}" inner_product_param {{ '
    "num_output: 47 }} }} "
)
DEPLOY = """
input: "x" input_shape {{ dim: 1 dim: 47 }} {0}
layer {{ name: "hand" type: "HandModel" bottom: "{1}" top: "pred" }}
"""


def test_a_deploy_net_with_a_layer_that_the_weights_lack(tmp_path: Path) -> None:
    """The error names the layer, because a layer with random weights would give
    meaningless figures.
    """
    one, two = LEARNED.format("one", "x"), LEARNED.format("two", "one")
    net = netlib.Net(prototxt.parse(DEPLOY.format(one, "one")), netlib.TEST)
    net.save(tmp_path / "w.caffemodel.h5")
    for text, top in ((one, "one"), (one + two, "two")):
        (tmp_path / f"{top}.prototxt").write_text(DEPLOY.format(text, top))
    deploy_of(net, tmp_path / "one.prototxt", tmp_path / "w.caffemodel.h5")
    with pytest.raises(
        WeightsError, match=r"w\.caffemodel\.h5: no weights for layer 'two' of net .*; it has one$"
    ):
        deploy_of(net, tmp_path / "two.prototxt", tmp_path / "w.caffemodel.h5")


INPUT = 'layer { name: "in" type: "Input" top: "depth" input_param { shape { dim: 1 dim: 1 dim: 4 dim: 4 } } }'
DATA = """layer {{ name: "data" type: "HDF5Data" top: "label" top: "depth"
                  hdf5_data_param {{ source: "{}" batch_size: 2 }} }}"""


def net_in(text: str) -> Net:
    """A test net."""
    return Net(prototxt.parse(text, "net.prototxt"), netlib.TEST)


@pytest.fixture
def of_file(tmp_path: Path) -> Net:
    """A net that reads five crops (1, 4, 4), of which each value is the number of its frame."""
    write_hdf5(
        tmp_path / "a.h5",
        depth=np.ones((5, 1, 4, 4), np.float32)
        * np.arange(5, dtype=np.float32)[:, None, None, None],
        label=np.zeros((5, 3), np.float32),
    )
    (tmp_path / "list.txt").write_text(f"{tmp_path / 'a.h5'}\n")
    return net_in(DATA.format(tmp_path / "list.txt"))


def test_the_data_of_a_test_net(of_file: Net) -> None:
    """The layer that reads the test set is found by its type; a net without is an error.

    Crops are found by number.
    """
    assert data_layer(of_file).rows == 5
    with pytest.raises(
        NetlibError, match="no HDF5Data layer in phase TEST; expected a net that reads a test set"
    ):
        data_layer(net_in(INPUT))
    assert [float(crop[0, 0]) for crop in crops_of(of_file, [3, 1])] == [3, 1]
    assert centers_of(of_file, np.arange(2)) == (None, NYU), "the files have no places"
