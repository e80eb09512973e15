"""Small weights files for the repository: rounded, compressed, together with the network's errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from handpose.depth_fit.network_errors import GROUP, NetworkErrors, arrays_of
from netlib.files import hdf5
from netlib.net import Net


def rounded(values: NDArray[np.float32], bits: int) -> NDArray[np.float32]:
    """The values with ``bits`` of the 23 bits of a mantissa, rounded to nearest, ties to even."""
    drop = np.uint32(23 - bits)
    raw = np.ascontiguousarray(values, np.float32).view(np.uint32)
    half = (np.uint32(1) << drop >> np.uint32(1)) - np.uint32(drop > 0) + ((raw >> drop) & np.uint32(1))
    kept = (raw + np.where(drop > 0, half, 0).astype(np.uint32)) >> drop << drop
    return np.asarray(kept.view(np.float32))


def write_model(net: Net, errors: NetworkErrors | None, path: Path) -> None:
    """Write the net's weights in Caffe's HDF5 format (float32), shuffled and compressed, with the network's errors."""
    with hdf5.created(path) as file:
        for layer, blobs in net.params.items():
            for i, blob in enumerate(blobs):
                values = np.asarray(blob.data, np.float32)
                file.create_dataset(f"data/{layer}/{i}", data=values, compression="gzip", compression_opts=9,
                                    shuffle=True)  # fmt: skip
        for name, values in arrays_of(errors).items() if errors else ():
            file.create_dataset(f"{GROUP}/{name}", data=values)
