"""Nets that predict hands: their layers, their input, and their predictions in float64."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import CUBE_MM
from handpose.fit.settings import Fit
from layers.hand.hand_model import HandModel
from layers.hand.sized_hand_model import SizedHandModel
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import NetlibError
from netlib.net import Net

PALM = "palm"  # every hand has this joint, and no other body
SIZES = 0.5, 2.0  # range of predicted sizes relative to the skeleton; values outside are clipped
JOINTS_BLOB = "joints"  # blob of joints that a net predicts in addition to those of its hand model


def hand_layer(net: Net) -> HandModel | None:
    """The HandModel layer of a net, or None."""
    return next((layer for layer in net.layers if isinstance(layer, HandModel)), None)


def the_hand_layer(net: Net) -> HandModel:
    """The HandModel layer of a net. Raises NetlibError without one."""
    hand = hand_layer(net)
    if hand is None:
        raise NetlibError(f"{net.source}: no HandModel layer, so the skeleton is unknown")
    return hand


def is_hand(skeleton: Skeleton) -> bool:
    """True for hands: only hands are searched for, have a side, and have crops that
    move to the palm.
    """
    return PALM in skeleton.joint_names


def refuse_other_bodies(skeleton: Skeleton, why: str) -> None:
    """Raise NetlibError for a skeleton that is not a hand; the reason ``why`` a hand is needed
    ends the message.
    """
    if not is_hand(skeleton):
        raise NetlibError(
            f"skeleton {skeleton.name!r} is not a hand: it has no joint {PALM!r}; {why}"
        )


def cube_of(skeleton: Skeleton, cube_mm: float | None) -> float:
    """The edge in mm of the cube around a body: ``cube_mm``, or NYU's for hands if it is None.

    Raises NetlibError.
    """
    if cube_mm is None:
        refuse_other_bodies(
            skeleton, "expected the edge of its cube in mm (--cube), which its prior has as cube_mm"
        )
    return CUBE_MM if cube_mm is None else cube_mm


def best_fit(net: Net) -> Fit:
    """The default fit for a net.

    "accurate" for hands; "fast" for other bodies, which cannot be turned by quarters; "no" for
    bodies without a surface and for nets that predict bone lengths.
    """
    try:
        skeleton = skeleton_to_fit(net)
    except NetlibError:
        return "no"
    if skeleton.param.flesh is None:
        return "no"
    return "accurate" if is_hand(skeleton) else "fast"


def skeleton_to_fit(net: Net) -> Skeleton:
    """The skeleton of the net's hand model.

    Raises NetlibError for a net without one, or that predicts bones.
    """
    return _layer_to_fit(net).skeleton


def _layer_to_fit(net: Net) -> HandModel:
    """The hand model of a net that predicts no bone lengths: a fit knows one size per hand only."""
    hand = the_hand_layer(net)
    bottoms = hand.spec.bottom
    if len(bottoms) > 1:
        bones = net.blobs[bottoms[1]]
        if bones.count != bones.num:  # otherwise one size for each hand
            raise NetlibError(
                f"{net.source}: layer {hand.name!r} takes the bones of each hand from blob "
                f"{bottoms[1]!r}, which a fit does not know; do without a fit, or give the "
                "layer one bottom, or two with a size"
            )
    return hand


class HandPoses(NamedTuple):
    """The predictions for N hands.

    inputs  (N, D) inputs of the skeleton; 0 for fixed DoFs
    size    (N,) relative to the skeleton; 1 for nets that do not predict it
    joints  (N, K, 3) half-cubes from the crop centres, from the blob ``joints``; None for
            nets without it
    """

    inputs: Array
    size: Array
    joints: Array | None


def hand_poses(net: Net, crops: NDArray[np.floating]) -> HandPoses:
    """Predict the poses in crops (N, size, size). Raises NetlibError."""
    hand = _layer_to_fit(net)
    found = _predicted(
        net, crops, [*hand.spec.bottom, *([JOINTS_BLOB] if JOINTS_BLOB in net.blobs else [])]
    )
    inputs = found[hand.spec.bottom[0]]
    size = np.ones(len(crops))
    if isinstance(hand, SizedHandModel):
        size = np.clip(found[hand.spec.bottom[1]][:, 0], *SIZES)
        inputs += (size - 1)[:, None] * hand.starts  # the size also scales the initial translations
    inputs[:, hand.skeleton.fixed] = 0
    return HandPoses(
        inputs,
        size,
        found[JOINTS_BLOB].reshape(len(crops), -1, 3) if JOINTS_BLOB in found else None,
    )


def network_joints(net: Net, crop: NDArray[np.floating]) -> Array:
    """Predict the joints (K, 3) in half-cubes in a crop (128, 128) of a right hand.

    Raises NetlibError.
    """
    name = JOINTS_BLOB if JOINTS_BLOB in net.blobs else "pred"
    return _predicted(net, crop[None], [name])[name].reshape(-1, 3)


def _predicted(net: Net, crops: NDArray[np.floating], names: Sequence[str]) -> dict[str, Array]:
    """The values (N, ...) of blobs for crops (N, size, size).

    Raises NetlibError for values that are not finite.

    The hand model is not always needed, but running a part of the net takes longer: it would not be
    run in slices.
    """
    outputs = net.forward(blobs=names, depth=np.ascontiguousarray(crops[:, None], dtype=np.float32))
    found = {name: outputs[name].reshape(len(crops), -1).astype(np.float64) for name in names}
    if not all(np.isfinite(values).all() for values in found.values()):
        raise NetlibError(f"{net.source}: predicts joints that are not finite; check its weights")
    return found
