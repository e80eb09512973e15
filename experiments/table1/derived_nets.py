"""The net of a network in a setting, derived by a recipe: its file with other data, and the recipe's changes.

The five files of the paper's networks stay comparable for readers; the trained nets are derived from them here.

DeepPrior's last layer (Oberweger et al. 2015, Sec. 3.2) gets its weights here, too: joints as a mean and a few
principal components,

    joints = mean + sum over k of number[k] * component[k]

Components are scaled by their standard deviation, so the numbers of the bottleneck have about unit size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from experiments.table1.networks import Network
from experiments.table1.recipes import Recipe
from experiments.table1.settings import SPLITS, Setting
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import hdf5
from netlib.proto import prototxt
from netlib.proto.prototxt import Message, Scalar

TEST_BATCH = 256
ROBUST_WEIGHT = 0.1  # loss weight of a SmoothL1Loss with sigma 10, as in synthetic_train_test.prototxt
ROBUST = "smooth_l1_loss_param { sigma: 10 }"

BOTTLENECK = 30  # components


def net_of(network: Network, setting: Setting, recipe: Recipe) -> Message:
    """The tree of the net that is trained and tested; its ``str`` is a prototxt. Raises PrototxtError."""
    net = prototxt.parse_file(network.model)
    for layer in layers_of(net):
        kind = text(layer, "type")
        if kind == "HDF5Data":
            _read_from(layer, network, setting, recipe)
        if kind == "PhysLimit" and network.limit is not None:
            weight, norm = network.limit
            _put(layer, f"loss_weight: {weight} phys_limit_param {{ norm: {norm} }}")
        if kind == "EuclideanLoss" and recipe.robust:
            weight = ROBUST_WEIGHT * float(text(layer, "loss_weight"))
            _put(layer, f'type: "SmoothL1Loss" loss_weight: {weight} {ROBUST}')
        if text(layer, "name") == "FC2" and recipe.robust:
            _put(_part(layer, "inner_product_param"), 'weight_filler { type: "xavier" }')
    if recipe.robust:
        net.fields = [
            f for f in net.fields if not (isinstance(f.value, Message) and text(f.value, "type") == "Dropout")
        ]
    return net


def _read_from(layer: Message, network: Network, setting: Setting, recipe: Recipe) -> None:
    """Let an HDF5Data layer read the setting's frames."""
    phase = text(_part(layer, "include"), "phase")
    split = SPLITS[("TRAIN", "TEST").index(phase)]
    block = _part(layer, "hdf5_data_param")
    source = Scalar("string", str(setting.list_of(split, network.labels == "fitted").absolute()), block.position)
    _put(block, f"source: {source} batch_size: {recipe.batch if phase == 'TRAIN' else TEST_BATCH}")


def layers_of(net: Message) -> Iterator[Message]:
    """The layers of a net."""
    return (field.value for field in net.fields if field.name == "layer" and isinstance(field.value, Message))


def text(message: Message, name: str) -> str:
    """The value of a field, as written; nothing if it is not there."""
    return next((value.text for value in message.values(name) if isinstance(value, Scalar)), "")


def _part(message: Message, name: str) -> Message:
    return next(value for value in message.values(name) if isinstance(value, Message))


def _put(message: Message, fields: str) -> None:
    """Give a message these fields: each in the place of the one of its name, or at the end."""
    for new in prototxt.parse(fields).fields:
        places = [i for i, old in enumerate(message.fields) if old.name == new.name]
        if places:
            message.fields[places[0]] = new
        else:
            message.fields.append(new)


def write_components(path: Path, files: Sequence[Path]) -> None:
    """Write weights of the layer "joints": mean and largest principal components of the joints in the files.

    Raises DataError.
    """
    parts: list[Array] = []
    for source in files:
        joints = hdf5.File(source, ("joint",)).datasets[0].numbers()
        if joints.ndim != 2 or any(joints.shape[1] != other.shape[1] for other in parts):
            raise DataError(f"{source}: data set 'joint' has shape {joints.shape}, expected (N, 3 K), as in all files")
        if not np.isfinite(joints).all():
            raise DataError(f"{source}: data set 'joint' has values that are not finite")
        parts.append(joints)
    joints = np.concatenate(parts)
    mean = joints.mean(axis=0)
    values, vectors = np.linalg.eigh(joints.T @ joints / len(joints) - np.outer(mean, mean))
    scaled = vectors[:, ::-1][:, :BOTTLENECK] * np.sqrt(np.maximum(values[::-1][:BOTTLENECK], 0))
    with hdf5.created(path) as file:
        file["data/joints/0"], file["data/joints/1"] = scaled.astype(np.float32), mean.astype(np.float32)
