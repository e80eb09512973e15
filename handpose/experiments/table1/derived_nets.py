"""The net of a network in a setting, derived by a recipe: its file with other data, and the recipe's changes.

The five files of the paper's networks stay comparable for readers; the trained nets are derived from them here.
"""

from __future__ import annotations

from collections.abc import Iterator

from handpose.experiments.table1.networks import Network
from handpose.experiments.table1.recipes import Recipe
from handpose.experiments.table1.settings import SPLITS, Setting
from netlib.proto import prototxt
from netlib.proto.prototxt import Message, Scalar

TEST_BATCH = 256
ROBUST_WEIGHT = 0.1  # loss weight of a SmoothL1Loss with sigma 10, as in synthetic_train_test.prototxt
ROBUST = "smooth_l1_loss_param { sigma: 10 }"


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
