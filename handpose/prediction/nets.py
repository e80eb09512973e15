"""The layers of a net that know about hands: where its frames come from, and where its joints are computed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.data import labels
from handpose.facts.cameras import NYU, Camera
from handpose.facts.nyu import CUBE_MM
from layers.data.hdf5_data import HDF5Data
from layers.hand.hand_model import HandModel
from layers.hand.sized_hand_model import SizedHandModel
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, NetlibError
from netlib.layer import TEST
from netlib.net import Net

PALM = "palm"  # the joint that makes a body a hand
SIZES = 0.5, 2.0  # of hands relative to the skeleton: a net that says another knows none
JOINTS = "joints"  # the blob of joints that a net says beside those of its hand model


def trained(model: str | Path, weights: str | Path, engine: str | None = None) -> Net:
    """A test net whose layers all have their weights: a hand from half of them would look like an answer.

    Raises NetlibError.
    """
    net = Net(model, TEST, engine=engine)
    net.copy_from(weights, strict=True)
    return net


def data_layer(net: Net) -> HDF5Data:
    """The layer that feeds a test net. Raises NetlibError if there is none."""
    for layer in net.layers:
        if isinstance(layer, HDF5Data):
            return layer
    raise NetlibError(f"{net.source}: no HDF5Data layer in phase TEST; expected a net that reads a test set")


def hand_layer(net: Net) -> HandModel | None:
    """The layer that turns angles into joints, if the net has one."""
    return next((layer for layer in net.layers if isinstance(layer, HandModel)), None)


def is_hand(skeleton: Skeleton) -> bool:
    """Is a body a hand? Hands are searched for, are left or right ones, and their crops are moved to their palms."""
    return PALM in skeleton.joint_names


def refuse_other_bodies(skeleton: Skeleton, why: str) -> None:
    """Raise NetlibError for a skeleton that is no hand."""
    if not is_hand(skeleton):
        raise NetlibError(f"skeleton {skeleton.name!r} is no hand, for it has no joint {PALM!r}; {why}")


def cube_of(skeleton: Skeleton, cube_mm: float | None) -> float:
    """The edge in mm of the cube around a body: what is given, and of hands NYU's otherwise. Raises NetlibError."""
    if cube_mm is None:
        refuse_other_bodies(skeleton, "expected the edge of its cube in mm (--cube), which its prior has as cube_mm")
    return CUBE_MM if cube_mm is None else cube_mm


def best_fit(model: str | Path) -> Literal["no", "fast", "accurate"]:
    """The plan that suits the net of a file. Only hands are turned by quarters, as the accurate one does.

    Bodies without flesh are not fitted, nor such whose bones the net predicts.

    Raises NetlibError.
    """
    net = Net(model, TEST)
    hand = hand_layer(net)
    if hand is None or hand.skeleton.param.flesh is None:
        return "no"
    try:
        _refuse_bones(net, hand)
    except NetlibError:
        return "no"
    return "accurate" if is_hand(hand.skeleton) else "fast"


def skeleton_to_fit(net: Net) -> Skeleton:
    """The skeleton of the net's hand model. Raises NetlibError for a net without one."""
    hand = hand_layer(net)
    if hand is None:
        raise NetlibError(f"{net.source}: no HandModel layer, so there is nothing to fit")
    _refuse_bones(net, hand)
    return hand.skeleton


def _refuse_bones(net: Net, hand: HandModel) -> None:
    """A fit knows the sizes of hands, but not all of their bones. Raises NetlibError."""
    if len(hand.spec.bottom) > 1 and net.blobs[hand.spec.bottom[1]].count != net.blobs[hand.spec.bottom[1]].num:
        raise NetlibError(f"{net.source}: layer {hand.name!r} takes the bones of each hand from blob "
                          f"{hand.spec.bottom[1]!r}, which a fit does not know; do without a fit, or give the "
                          "layer one bottom, or two with a size")  # fmt: skip


def crops_of(net: Net, frames: Iterable[int]) -> list[Array]:
    """The crops (size, size) of some frames that a test net reads, by their numbers. Raises NetlibError."""
    data = data_layer(net)
    depth = data.spec.top.index("depth")
    return [data.row(int(frame))[depth][0] for frame in frames]


def centers_of(net: Net, frames: NDArray[np.int_]) -> tuple[Array | None, Camera]:
    """Where crops of some frames were cut (n, 3), px, px, mm, and the camera; nothing where the files do not say."""
    try:
        centers, camera = labels.read_crop_centers(data_layer(net).files)
    except DataError:
        return None, NYU
    return np.asarray(centers[frames]), camera


class HandPoses(NamedTuple):
    """What a net says of N hands.

    inputs  (N, D) of the skeleton, its limbs' angles among them; 0 for fixed DoFs
    size    (N,) of each hand relative to the skeleton; 1 of nets that do not say it
    joints  (N, K, 3) half-cubes from the crop centres, of nets that say them apart from the inputs: their blob joints
    """

    inputs: Array
    size: Array
    joints: Array | None


def hand_poses(net: Net, crops: NDArray[np.floating]) -> HandPoses:
    """What the net says of crops (N, size, size), in float64. Raises NetlibError."""
    hand = hand_layer(net)
    if hand is None:
        raise NetlibError(f"{net.source}: no HandModel layer, so there are no angles")
    _refuse_bones(net, hand)
    names = [*hand.spec.bottom, *([JOINTS] if JOINTS in net.blobs else [])]
    depth = np.ascontiguousarray(crops[:, None], dtype=np.float32)
    if net.blobs["depth"].shape != depth.shape:
        net.blobs["depth"].reshape(*depth.shape)
    # The hand model is not needed, but takes less than a net that is run in parts, which is no longer run in slices.
    outputs = net.forward(blobs=names, depth=depth)
    found = {name: outputs[name].reshape(len(crops), -1).astype(np.float64) for name in names}
    if not all(np.isfinite(values).all() for values in found.values()):
        raise NetlibError(f"{net.source}: predicts joints that are not finite; check its weights")
    inputs, size = found[hand.spec.bottom[0]], np.ones(len(crops))
    if isinstance(hand, SizedHandModel):
        size = np.clip(found[hand.spec.bottom[1]][:, 0], *SIZES)
        inputs += (size - 1)[:, None] * hand.starts  # a factor of the initial translations, too
    inputs[:, hand.skeleton.fixed] = 0
    return HandPoses(inputs, size, found[JOINTS].reshape(len(crops), -1, 3) if JOINTS in found else None)


def hand_inputs(net: Net, crops: NDArray[np.floating]) -> Array:
    """The inputs (N, D) of ``hand_poses``. Raises NetlibError."""
    return hand_poses(net, crops).inputs
