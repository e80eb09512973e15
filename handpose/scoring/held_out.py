"""Run a trained net over a held-out set and say how good its poses are, in mm."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from handpose.data import labels
from handpose.facts.nyu import ANNOTATION_OF_JOINT, EVALUATION_JOINTS
from handpose.predicting.nets import data_layer, hand_layer
from handpose.scoring import metrics
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, NetlibError, printable
from netlib.net import Net


@dataclass(frozen=True)
class Predictions:
    """A net's answers for every frame of a test set, in order."""

    joints: Array  # (N, K, 3) predicted, half-cubes
    truth: Array  # (N, K, 3) annotated, half-cubes
    dof: Array | None  # (N, D) predicted inputs of the hand model, if the net has one
    skeleton: Array | None  # (N, all joints of the skeleton, 3) where the hand model puts them, half-cubes
    half_cube: Array  # (N,) mm
    outputs: dict[str, float]  # mean of every scalar output of the net
    made_from: str  # what the data are


def predict_all(
    net: Net, prediction: str = "pred", truth: str = "joint", progress: Callable[[int], None] = lambda done: None
) -> Predictions:
    """Run the whole test set once, from its first frame. ``progress`` is told the number of frames done."""
    data, hand = data_layer(net), hand_layer(net)
    for name in (prediction, truth):
        if name not in net.blobs:
            raise NetlibError(f"{net.source}: no blob {name!r}; expected the net to make 'pred' and to read 'joint'")
    if data.param.shuffle:
        raise NetlibError(f"{net.source}: layer {data.name!r} shuffles its frames; a test set is read in order")
    data.rewind()
    wanted = [prediction, truth, *((hand.spec.bottom[0], hand.spec.top[0]) if hand else ())]
    found: dict[str, list[Array]] = {name: [] for name in wanted}
    sums: dict[str, list[float]] = {name: [] for name in net.outputs if net.blobs[name].count == 1}
    if data.rows % data.param.batch_size:  # a last batch would run over into the first rows and count them twice
        data.use_batch_size(math.gcd(data.rows, data.param.batch_size))
        net.reshape()
    done = 0
    while done < data.rows:
        net.run_forward()
        take = data.batch_size
        for name in found:
            found[name].append(net.blobs[name].data[:take].reshape(take, -1).copy())
        for name, values in sums.items():
            values.append(float(net.blobs[name].data.sum()))
        done += take
        progress(done)
    arrays = {name: np.concatenate(parts) for name, parts in found.items()}
    return Predictions(
        joints=arrays[prediction].reshape(done, -1, 3),
        truth=arrays[truth].reshape(done, -1, 3),
        dof=arrays[hand.spec.bottom[0]] if hand else None,
        skeleton=arrays[hand.spec.top[0]].reshape(done, -1, 3) if hand else None,
        half_cube=np.concatenate([labels.read_half_cubes(file) for file in data.files]),
        outputs={name: float(np.mean(values)) for name, values in sums.items()},
        made_from=", ".join(sorted({printable(file.made_from) for file in data.files})),
    )


def figures_of(p: Predictions, skeleton: Skeleton) -> dict[str, float]:
    """Figures of a test set: mean errors in mm, and fractions of frames.

    error_mm          mean over all joints               error_14_mm   over the 14 evaluation joints
    within_20_mm, within_40_mm   frames whose largest error over the 14 joints is at most that
    out_of_limits     frames with an angle beyond its limit (only for nets with a hand model)
    """
    for what, values in (("predicted", p.joints), ("annotated", p.truth)):
        wrong = ~np.isfinite(values).all(axis=(1, 2))
        if wrong.any():
            raise DataError(
                f"the {what} joints of frame {int(wrong.argmax())} are not finite ({wrong.sum()} such frames)"
            )
    scale = p.half_cube[:, None, None]
    errors = metrics.joint_errors(p.joints * scale, p.truth * scale)
    few = errors[:, list(EVALUATION_JOINTS)] if errors.shape[1] == len(ANNOTATION_OF_JOINT) else errors
    within = metrics.success_rate(few, [20.0, 40.0])
    figures = {
        "error_mm": metrics.mean_error(errors),
        "error_14_mm": metrics.mean_error(few),
        "within_20_mm": float(within[0]),
        "within_40_mm": float(within[1]),
    }
    if p.dof is not None:
        figures["out_of_limits"] = metrics.fraction_out_of_limits(
            p.dof, skeleton.lower, skeleton.upper, skeleton.fixed, tolerance=1e-6
        )
    return figures
