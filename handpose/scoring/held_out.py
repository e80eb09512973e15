"""Run a trained net over a held-out set, and fit its hands to the depth; the errors of
the poses in mm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import CUBE_MM, EVALUATION_JOINTS
from handpose.datasets import labels
from handpose.estimate.crop_fits import MAX_CROPS, fit_crops
from handpose.estimate.nets import hand_layer, skeleton_to_fit
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.observation import HandCrops
from handpose.fit.settings import Plan
from handpose.frames.cameras import NYU, Camera
from handpose.scoring import metrics
from layers.data.hdf5_data import HDF5Data
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib.blob import Array, blocks
from netlib.errors import DataError, NetlibError, printable
from netlib.files.hdf5 import File
from netlib.layer import TEST
from netlib.net import Net


def data_layer(net: Net) -> HDF5Data:
    """The HDF5Data layer of a test net. Raises NetlibError if there is none."""
    for layer in net.layers:
        if isinstance(layer, HDF5Data):
            return layer
    raise NetlibError(
        f"{net.source}: no HDF5Data layer in phase TEST; expected a net that reads a test set"
    )


def crops_of(net: Net, frames: Iterable[int]) -> list[Array]:
    """The crops (size, size) of frames of a test net's data set, by number. Raises NetlibError."""
    data = data_layer(net)
    depth = data.spec.top.index("depth")
    return [data.row(int(frame))[depth][0] for frame in frames]


def centers_of(net: Net, frames: NDArray[np.int_]) -> tuple[Array | None, Camera]:
    """The crop centres (n, 3) in px, px, mm of frames of a test net's data set, and the camera.

    The centres are None if the files do not have them.
    """
    try:
        centers, camera = labels.read_crop_centers(data_layer(net).files)
    except DataError:
        return None, NYU
    return centers[frames], camera


@dataclass(frozen=True)
class Predictions:
    """A net's predictions for every frame of a test set, in order."""

    joints: Array  # (N, K, 3) predicted, half-cubes
    truth: Array  # (N, K, 3) annotated, half-cubes
    dof: Array | None  # (N, D) predicted inputs of the hand model, if the net has one
    # (N, all joints of the skeleton, 3) as posed by the hand model, half-cubes
    skeleton: Array | None
    half_cube: Array  # (N,) mm
    outputs: dict[str, float]  # mean of every scalar output of the net
    made_from: str  # description of the data

    @property
    def errors_mm(self) -> Array:
        """Errors (N, K) of the joints."""
        scale = self.half_cube[:, None, None]
        return metrics.joint_errors(self.joints * scale, self.truth * scale)


def predict_all(net: Net, progress: Callable[[int], None] = lambda done: None) -> Predictions:
    """Run the whole test set once, from its first frame.

    ``progress`` is called with the number of frames done.

    Raises NetlibError, DataError for labels that cannot be scored.
    """
    data = data_layer(net)
    hand = hand_layer(net)
    for name in ("pred", "joint"):
        if name not in net.blobs:
            raise NetlibError(
                f"{net.source}: no blob {name!r}; expected the net to make 'pred' and to read 'joint'"
            )
    if data.param.shuffle:
        raise NetlibError(
            f"{net.source}: layer {data.name!r} shuffles its frames; a test set is read in order"
        )
    data.rewind()
    wanted = ["pred", "joint", *((hand.spec.bottom[0], hand.spec.top[0]) if hand else ())]
    arrays, outputs = _run_over(net, data, wanted, progress)
    _check_annotated(arrays["joint"], data.files)
    origins = {printable(file.made_from) for file in data.files}
    return Predictions(
        joints=arrays["pred"].reshape(data.rows, -1, 3),
        truth=arrays["joint"].reshape(data.rows, -1, 3),
        dof=arrays[hand.spec.bottom[0]] if hand else None,
        skeleton=arrays[hand.spec.top[0]].reshape(data.rows, -1, 3) if hand else None,
        half_cube=np.concatenate([labels.read_half_cubes(file) for file in data.files]),
        outputs=outputs,
        made_from=", ".join(sorted(origins)),
    )


def _run_over(
    net: Net, data: HDF5Data, wanted: Sequence[str], progress: Callable[[int], None]
) -> tuple[dict[str, Array], dict[str, float]]:
    """The blobs ``wanted`` (N, values) of all N rows of the data, each read once, by name; and the
    mean of every scalar output.
    """
    found: dict[str, list[Array]] = {name: [] for name in wanted}
    scalars: dict[str, list[float]] = {
        name: [] for name in net.outputs if net.blobs[name].count == 1
    }
    # the last batch would wrap around to the first rows and count them twice
    if data.rows % data.param.batch_size:
        data.use_batch_size(math.gcd(data.rows, data.param.batch_size))
        net.reshape()
    size = data.batch_size
    for done in range(size, data.rows + 1, size):
        net.run_forward()
        for name, batches in found.items():
            batches.append(net.blobs[name].data[:size].reshape(size, -1).copy())
        for name, values in scalars.items():
            values.append(float(net.blobs[name].data.sum()))
        progress(done)
    arrays = {name: np.concatenate(batches) for name, batches in found.items()}
    return arrays, {name: float(np.mean(values)) for name, values in scalars.items()}


def _check_annotated(joints: Array, files: Sequence[File]) -> None:
    """Raise DataError if joints (N, ...) of the files' frames, one file after the other,
    are not finite.
    """
    wrong = np.asarray(~np.isfinite(joints).all(axis=1))
    start = 0
    for file in files:
        own = wrong[start : start + file.rows]
        if own.any():
            raise DataError(
                f"{file.path}: the annotated joints of frame {own.argmax()} are not finite ({own.sum()} such frames)"
            )
        start += file.rows


def errors_by_joint(p: Predictions, skeleton: Skeleton) -> dict[str, float]:
    """The mean error in mm of each joint, by its name; by its number if the net does not
    predict all joints.
    """
    errors = p.errors_mm.mean(axis=0)
    whole = len(errors) == len(skeleton.joint_names)
    return {
        skeleton.joint_names[k] if whole else str(k): float(error) for k, error in enumerate(errors)
    }


def figures_of(p: Predictions, skeleton: Skeleton) -> dict[str, float]:
    """Figures of a test set: mean errors in mm, and fractions of frames.

    error_mm          mean over all joints
    error_14_mm       over NYU's 14 evaluation joints, of a net of NYU's hand
    within_20_mm, within_40_mm   frames whose largest error (of NYU's hand: over the 14 joints) is
                                 at most that; of a
                      larger body at most the same part of its cube, in whole mm
    out_of_limits     frames with an angle beyond its limit (only for nets with a model of the body)
    """
    wrong = ~np.isfinite(p.joints).all(axis=(1, 2))
    if wrong.any():
        raise DataError(
            f"the predicted joints of frame {wrong.argmax()} are not finite ({wrong.sum()} such frames)"
        )
    errors = p.errors_mm
    figures = {"error_mm": float(errors.mean())}
    if skeleton.joint_names == skeletons.load().joint_names and errors.shape[1] == len(
        skeleton.joint_names
    ):
        errors = errors[:, list(EVALUATION_JOINTS)]
        figures["error_14_mm"] = float(errors.mean())
    larger = max(1.0, 2 * float(p.half_cube.max()) / CUBE_MM)
    for threshold in (round(20 * larger), round(40 * larger)):
        figures[f"within_{threshold}_mm"] = float(metrics.success_rate(errors, [threshold])[0])
    if p.dof is not None:
        figures["out_of_limits"] = metrics.fraction_out_of_limits(
            p.dof, skeleton.lower, skeleton.upper, skeleton.fixed, tolerance=1e-6
        )
    return figures


def deploy_of(net: Net, model: str | Path, weights: str | Path, engine: str | None = None) -> Net:
    """The net of ``model``, which is the test net with an input.

    Raises NetlibError, also for that of another body.
    """
    deploy = Net(model, TEST, engine=engine)
    hand = hand_layer(net)
    own = skeleton_to_fit(deploy)
    if hand is not None and hand.skeleton.param != own.param:
        other = f"{hand.skeleton.name!r}" + (
            ", with other numbers" if hand.skeleton.name == own.name else ""
        )
        raise NetlibError(
            f"{deploy.source}: its body is {own.name!r}, that of {net.source} is {other}; "
            "expected the same net with an input (--deploy)"
        )
    deploy.copy_from(weights, strict=True)
    return deploy


def fit_all(
    net: Net,
    deploy: Net,
    weights: str | Path,
    plan: Plan,
    progress: Callable[[int], None] = lambda done: None,
) -> Array:
    """Joints (N, K, 3) in half-cubes of every frame that the test net reads, fitted from the
    predictions of ``deploy``.

    weights  the weights file of both nets; it may contain the network's errors
    """
    data = data_layer(net)
    skeleton = skeleton_to_fit(deploy)
    half = np.concatenate([labels.read_half_cubes(file) for file in data.files])
    centers, camera = labels.read_crop_centers(data.files)
    joints = np.zeros((len(half), len(skeleton.joint_names), 3))
    done = 0
    for unit in np.unique(half):
        fitter = DepthFitter.of_file(skeleton, weights, float(unit))
        own = np.flatnonzero(half == unit)
        for rows in blocks(len(own), MAX_CROPS):
            crops = np.stack(crops_of(net, own[rows]))
            hands = HandCrops(crops, centers[own[rows]], camera, 2 * float(unit))
            found = fit_crops(deploy, fitter, hands, plan)
            joints[own[rows]] = found.joints / unit
            done += len(crops)
            progress(done)
    return joints
