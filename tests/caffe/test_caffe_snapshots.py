"""Real Caffe's snapshots, in both formats, compared with netlib's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import netlib
from netlib.proto import prototxt, schema, wire
from netlib.proto.messages import NetParameter, SolverState
from netlib.snapshots import snapshot
from tests.caffe.recorded import Follow, distance, trajectory

pytestmark = pytest.mark.both_engines

CASE = "snap_sgd_hdf5"  # the recorded training with snapshots after 10 and after 20 updates
ITERATIONS = pytest.mark.parametrize("iteration", [10, 20])
FORMATS = pytest.mark.parametrize(
    ("theirs", "format"),
    [
        ("snap/snap_sgd_hdf5_iter_%s.%s.h5", "HDF5"),
        ("snap/snap_sgd_binaryproto_iter_%s.%s", "BINARYPROTO"),
    ],
)


@pytest.fixture
def ours(solvers: Path, tmp_path: Path) -> Path:
    """A folder with the snapshots that netlib's solver writes in the same training."""
    prefix = tmp_path / "snap_sgd_hdf5"
    solver = netlib.get_solver(f"solver_{CASE}.prototxt", snapshot_prefix=str(prefix), display=0)
    solver.copy_weights("init.caffemodel.h5")
    assert solver.solve()
    return tmp_path


@FORMATS
def test_training_goes_on_from_caffes_solver_state(
    solvers: Path, tmp_path: Path, theirs: str, format: str
) -> None:
    """Resumed from iteration 10, training follows Caffe's own resumed training to iteration 20 and
    its last snapshot.

    Caffe's resumed and uninterrupted trainings are equal, number for number: after 10 batches of 8,
    the 40 rows of data are at their first row in both.
    """
    changes = {"snapshot_prefix": str(tmp_path / "ours"), "display": 0, "snapshot_format": format}
    solver = netlib.get_solver(f"solver_{CASE}.prototxt", **changes)
    solver.restore(theirs % ("10", "solverstate"))
    assert solver.iter == 10
    follow = Follow(solver, trajectory(CASE))
    assert solver.solve()
    assert (follow.updates, solver.iter) == (10, 20)
    assert follow.compared == 5 * 10 + 1
    assert max(follow.worst, follow.worst_loss) <= 1e-5
    suffix = ".h5" if format == "HDF5" else ""
    check_weights(tmp_path / f"ours_iter_20.caffemodel{suffix}", theirs % ("20", "caffemodel"))
    check_state(tmp_path / f"ours_iter_20.solverstate{suffix}", theirs % ("20", "solverstate"))


@ITERATIONS
@FORMATS
def test_snapshots_have_the_same_values_as_caffes(
    ours: Path, iteration: int, theirs: str, format: str
) -> None:
    name = f"{CASE}_iter_{iteration}"
    check_weights(ours / f"{name}.caffemodel.h5", theirs % (iteration, "caffemodel"))
    check_state(ours / f"{name}.solverstate.h5", theirs % (iteration, "solverstate"))
    if format == "BINARYPROTO":
        names = [theirs % (iteration, kind) for kind in ("solverstate", "caffemodel")]
        assert snapshot.read_state(names[0]).learned_net == names[1]


def check_weights(mine: str | Path, theirs: str | Path) -> None:
    """Assert that two files of weights of the same training agree."""
    a, b = snapshot.read_weights(mine), snapshot.read_weights(theirs)
    assert a.keys() == b.keys()
    for layer, arrays in b.items():
        assert a[layer].keys() == arrays.keys()
        assert all(distance(a[layer][index], array) <= 1e-5 for index, array in arrays.items())


def check_state(mine: str | Path, theirs: str | Path) -> None:
    """Assert that two solver states of the same training agree."""
    a, b = snapshot.read_state(mine), snapshot.read_state(theirs)
    assert (a.iter, a.current_step) == (b.iter, b.current_step)
    assert [h.shape for h in a.history] == [h.shape for h in b.history]
    assert all(distance(h, g) <= 1e-5 for h, g in zip(a.history, b.history))
    assert all(f"_iter_{b.iter}.caffemodel" in Path(state.learned_net).name for state in (a, b))


@pytest.mark.parametrize("kind", ["caffemodel", "solverstate"])
def test_our_file_has_the_layout_of_caffes(ours: Path, kind: str) -> None:
    """Names, shapes and types in the files are Caffe's; a solver state also has the data for an
    exact resumption.
    """
    name = f"{CASE}_iter_10.{kind}.h5"
    mine, theirs = layout(ours / name), layout(Path("snap") / name)
    assert set(mine) - set(theirs) == ({"netlib"} if kind == "solverstate" else set())
    assert {key: mine[key] for key in theirs} == theirs


def layout(path: Path) -> dict[str, Any]:
    """Return name -> shape and type; strings of any length have the same type."""
    found: dict[str, Any] = {}

    def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
        dataset = isinstance(item, h5py.Dataset)
        found[name] = (
            (item.shape, item.dtype.str if item.dtype.kind != "S" else "S") if dataset else "group"
        )

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


def test_caffes_binary_files_are_read_and_written_byte_for_byte(solvers: Path) -> None:
    """Binary weights and states are read and rewritten with the same fields, numbers and order as
    in Caffe's files.
    """
    files = [
        Path("init.caffemodel"),
        Path("init_shared.caffemodel"),
        *Path("snap").glob("*.caffemodel"),
    ]
    states = sorted(Path("snap").glob("*.solverstate"))
    assert (len(files), len(states)) == (4, 2)
    for path, cls in [
        *((path, NetParameter) for path in files),
        *((path, SolverState) for path in states),
    ]:
        data = path.read_bytes()
        tree = wire.decode(data, cls, str(path))
        assert wire.encode(tree, cls) == data
        assert wire.encode(schema.to_tree(schema.read(tree, cls)), cls) == data


@pytest.mark.parametrize(("net", "weights"), [("net", "init"), ("net_shared", "init_shared")])
def test_a_net_loaded_and_saved_is_caffes_file_byte_for_byte(
    solvers: Path, tmp_path: Path, net: str, weights: str
) -> None:
    made = netlib.Net(f"{net}.prototxt", netlib.TRAIN)
    made.copy_from(f"{weights}.caffemodel")
    made.save(tmp_path / "ours.caffemodel")
    assert (tmp_path / "ours.caffemodel").read_bytes() == Path(f"{weights}.caffemodel").read_bytes()


LENET = """
    layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 28 dim: 28 } } }
    layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1"
            convolution_param { num_output: 20 kernel_size: 5 } }
    layer { name: "pool1" type: "Pooling" bottom: "conv1" top: "pool1" pooling_param { kernel_size: 2 stride: 2 } }
    layer { name: "conv2" type: "Convolution" bottom: "pool1" top: "conv2"
            convolution_param { num_output: 50 kernel_size: 5 } }
    layer { name: "pool2" type: "Pooling" bottom: "conv2" top: "pool2" pooling_param { kernel_size: 2 stride: 2 } }
    layer { name: "ip1" type: "InnerProduct" bottom: "pool2" top: "ip1" inner_product_param { num_output: 500 } }
    layer { name: "relu1" type: "ReLU" bottom: "ip1" top: "ip1" }
    layer { name: "ip2" type: "InnerProduct" bottom: "ip1" top: "ip2" inner_product_param { num_output: 10 } }
    layer { name: "prob" type: "Softmax" bottom: "ip2" top: "prob" }
"""


def test_a_real_lenet_reads_digits(whole: Path) -> None:
    """Binary weights trained by Caffe classify 1,952 of these 2,000 digits correctly,
    as in PyTorch.
    """
    folder = whole.parent / "lenet"
    digits = np.load(folder / "mnist_test_2000.npz")
    images = digits[next(name for name in digits if digits[name].ndim >= 3)]
    labels = digits[next(name for name in digits if digits[name].ndim == 1)]
    net = netlib.Net(
        prototxt.parse(LENET), str(folder / "lenet_iter_10000.caffemodel"), netlib.TEST
    )
    data = images.reshape(-1, 1, 28, 28) / np.float32(256)
    found = net.forward(data=data)["prob"].argmax(axis=1)
    assert abs((found == labels).sum() - 1952) <= 1
    assert snapshot.read_state(folder / "lenet_iter_10000.solverstate").iter == 10000


def test_shared_weights_load_from_caffes_snapshot(solvers: Path, tmp_path: Path) -> None:
    """Caffe's HDF5 file has the weights shared by ipA and ipB once, and so does the file that
    netlib writes.
    """
    net = netlib.Net("net_shared.prototxt", "init_shared.caffemodel.h5", netlib.TEST)
    binary = snapshot.read_weights("init_shared.caffemodel")
    for layer, blobs in net.params.items():
        assert len(blobs) == len(binary[layer])
        assert all(np.array_equal(blob.data, binary[layer][i]) for i, blob in enumerate(blobs))
    assert all(
        np.shares_memory(a.data, b.data) for a, b in zip(net.params["ipA"], net.params["ipB"])
    )
    net.save(tmp_path / "ours.caffemodel.h5")
    assert layout(tmp_path / "ours.caffemodel.h5") == layout(Path("init_shared.caffemodel.h5"))
