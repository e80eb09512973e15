"""The layers of a net that know about hands: where its frames come from, and where its joints are computed."""

from __future__ import annotations

from collections.abc import Iterable

from layers.data.hdf5_data import HDF5Data
from layers.hand.hand_model import HandModel
from netlib.blob import Array
from netlib.errors import NetlibError
from netlib.net import Net


def data_layer(net: Net) -> HDF5Data:
    """The layer that feeds a test net. Raises NetlibError if there is none."""
    for layer in net.layers:
        if isinstance(layer, HDF5Data):
            return layer
    raise NetlibError(f"{net.source}: no HDF5Data layer in phase TEST; expected a net that reads a test set")


def hand_layer(net: Net) -> HandModel | None:
    """The layer that turns angles into joints, if the net has one."""
    return next((layer for layer in net.layers if isinstance(layer, HandModel)), None)


def crops_of(net: Net, frames: Iterable[int]) -> list[Array]:
    """The crops (size, size) of some frames that a test net reads, by their numbers. Raises NetlibError."""
    data = data_layer(net)
    depth = data.spec.top.index("depth")
    return [data.row(int(frame))[depth][0] for frame in frames]
