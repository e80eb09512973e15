"""The data of a test net: its layer, its crops, and their places in the frames."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from handpose.datasets import labels
from handpose.frames.cameras import NYU, Camera
from layers.data.hdf5_data import HDF5Data
from netlib.blob import Array
from netlib.errors import DataError, NetlibError
from netlib.net import Net


def data_layer(net: Net) -> HDF5Data:
    """The HDF5Data layer of a test net. Raises NetlibError if there is none."""
    for layer in net.layers:
        if isinstance(layer, HDF5Data):
            return layer
    raise NetlibError(f"{net.source}: no HDF5Data layer in phase TEST; expected a net that reads a test set")


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
    return np.asarray(centers[frames]), camera
