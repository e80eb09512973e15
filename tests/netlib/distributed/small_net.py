"""A small net on three files of rows, for training on ranks in tests."""

from pathlib import Path

import numpy as np

import netlib
from tests.support.hdf5_files import write_hdf5

NET = """
layer { name: "data" type: "HDF5Data" top: "x" top: "y" include { phase: TRAIN }
        hdf5_data_param { source: "list.txt" batch_size: 8 } }
layer { name: "data" type: "HDF5Data" top: "x" top: "y" include { phase: TEST }
        hdf5_data_param { source: "list.txt" batch_size: 9 } }
layer { name: "fc1" type: "InnerProduct" bottom: "x" top: "h"
        inner_product_param { num_output: 20 weight_filler { type: "xavier" } } }
layer { name: "relu" type: "ReLU" bottom: "h" top: "h" }
layer { name: "fc2" type: "InnerProduct" bottom: "h" top: "p"
        inner_product_param { num_output: 2 weight_filler { type: "xavier" } } }
layer { name: "loss" type: "EuclideanLoss" bottom: "p" bottom: "y" top: "loss" }
"""
SOLVER = """
net: "small.prototxt" type: "SGD" base_lr: 0.001 momentum: 0.9 lr_policy: "fixed" max_iter: 1000000 display: 20
test_iter: 3 test_interval: 40 snapshot: 20 snapshot_prefix: "snapshots/small" random_seed: 3
"""
ADAM = """
net: "small.prototxt" type: "Adam" base_lr: 0.01 momentum: 0.9 momentum2: 0.999 lr_policy: "fixed" clip_gradients: 5
iter_size: 2 max_iter: 100 random_seed: 3
"""


def write_files() -> None:
    """Write the data, small.prototxt, and solver.prototxt for a long training run to the
    working directory.
    """
    rng = np.random.default_rng(0)
    for i, rows in enumerate((31, 9, 20)):
        x = rng.standard_normal((rows, 6)).astype(np.float32)
        write_hdf5(f"d{i}.h5", x=x, y=x[:, :2] - x[:, 2:4])
    Path("list.txt").write_text("d0.h5\nd1.h5\nd2.h5\n")
    Path("small.prototxt").write_text(NET)
    Path("solver.prototxt").write_text(SOLVER)


def whole_snapshot() -> int:
    """Return the iteration of the newest solver state, after restoring it."""
    solver = netlib.get_solver("solver.prototxt")
    states = sorted(
        Path("snapshots").glob("*.solverstate"), key=lambda path: int(path.stem.split("_")[-1])
    )
    solver.restore(states[-1])
    return solver.iter
