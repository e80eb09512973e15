"""Make exercises/recorded.npz from tests/caffe: a part of the recordings, with unchanged numbers.

python -m tests.exercises.reduce_recordings

Only the first image of the convolutions and poolings is kept, so their parameter gradients, which
sum over all images, are left out.
"""

from __future__ import annotations

from collections.abc import Iterator

import h5py
import numpy as np

from exercises import recorded
from netlib.snapshots import snapshot
from tests.caffe.recorded import FOLDER, layer_cases, trajectory

LAYERS = {
    "relu",
    "relu_neg",
    "ip_4d",
    "ip_axis2",
    "conv_k3",
    "conv_k3_s2_p1",
    "conv_group2",
    "conv_dil2_p2_s2",
    "pool_MAX_k3s2p1_odd",
    "pool_MAX_k4s4_even",
    "pool_MAX_k2s2_odd",
    "pool_MAX_ties",
    "pool_AVE_k3s2p1_odd",
    "pool_AVE_k2s2_odd",
    "split_explicit",
    "euclid",
    "euclid_lw3",
    "dropout_test",
    "dropout_train_ratio0",
}
KINDS = ("in", "param", "top", "topdiff", "indiff", "pdiff")
FIRST_IMAGE = ("conv_", "pool_")
POSES = [2, 3, 12, 30]  # of the hand's 32: small angles, any angles, one DoF
# of the training runs: long enough to include the step that lowers the rate after 6 iterations
UPDATES = 8
TRAININGS = ("sgd_mom09", "snap_sgd_hdf5")
WEIGHTS = (("conv", 1), ("ip2", 0), ("ip2", 1))  # the recorded weights; they depend on all others


def arrays() -> dict[str, np.ndarray]:
    """Return all arrays that the exercises need."""
    return {**dict(of_layers()), **dict(of_hand()), **dict(of_training())}


def of_layers() -> Iterator[tuple[str, np.ndarray]]:
    for case in layer_cases():
        first = case.name.startswith(FIRST_IMAGE)
        for kind in KINDS if case.name in LAYERS else ():
            for i, (_, array) in enumerate([] if first and kind == "pdiff" else case.of(kind)):
                yield (
                    f"{case.name}/{kind}/{i}",
                    array.single[:1] if first and kind != "param" else array.single,
                )


def of_hand() -> Iterator[tuple[str, np.ndarray]]:
    with np.load(FOLDER / "hand_model.npz") as hand:
        for name in ("bottom", "top_f64", "top_diff", "bottom_diff_f64"):
            yield f"hand_model/{name}", hand[name][POSES]
    with np.load(FOLDER / "phys_limit.npz") as limits:
        yield "phys_limit/in/0", limits["bottom"]
        yield "phys_limit/top/0", limits["loss_w1"]
        yield "phys_limit/topdiff/0", np.ones((), np.float32)
        # Caffe leaves the diffs of fixed DoFs unwritten; they have no effect, so they are set to 0
        free = np.isin(np.arange(47), [*range(6), *range(15, 19), *range(31, 47)])
        yield "phys_limit/indiff/0", np.where(free, limits["bottom_diff_w1"], np.float32(0))


def of_training() -> Iterator[tuple[str, np.ndarray]]:
    for name in ("data", "label"):
        parts = []
        for i in range(2):
            with h5py.File(FOLDER / f"solvers/train{i}.h5") as file:
                parts.append(file[name][...])
        yield f"training/{name}", np.concatenate(parts)
    for layer, params in snapshot.read_weights(FOLDER / "solvers/init.caffemodel.h5").items():
        for i, array in params.items():
            yield f"training/init/{layer}/{i}", array
    for case in TRAININGS:
        course = trajectory(case)
        for layer, i in WEIGHTS:
            steps = course.weights[layer, i]
            yield (
                f"training/{case}/{layer}/{i}",
                np.stack([steps[t] for t in range(1, UPDATES + 1)]),
            )


def main() -> None:
    np.savez_compressed(recorded.FILE, **arrays())


if __name__ == "__main__":
    main()
