"""HDF5Output: write two bottoms to an HDF5 file.

bottom[0]  (N, ...)  written to the data set "data"
bottom[1]  (N, ...)  written to the data set "label"

Both are written with four axes, as in Caffe: axes of size 1 are appended. A file holds one batch,
that of the first forward; a second forward is an error, as in Caffe. The file is written
atomically. A file that a data layer of this process reads is rejected.

dx_i = 0
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from netlib import files
from netlib.blob import Blobs
from netlib.files import hdf5, reading
from netlib.layer import ZeroGradient
from netlib.proto.schema import numbered

NAMES = ("data", "label")


@dataclass(frozen=True)
class HDF5OutputParameter:
    """The ``hdf5_output_param { ... }`` block."""

    file_name: str = numbered(1)  # relative to the working directory


class HDF5Output(ZeroGradient):
    """Writes a batch to a file."""

    param: HDF5OutputParameter
    param_name = "hdf5_output_param"
    bottoms = (2, 2)
    tops = (0, 0)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.path = Path(self.param.file_name)
        self.written = False
        if not self.path.name or self.path.is_dir():
            raise self.fail(f"file_name {self.param.file_name!r} is not a file name", "file_name")
        if not self.path.parent.is_dir():
            raise self.fail(
                f"file_name {self.param.file_name!r}: {self.path.parent} is not a folder",
                "file_name",
            )
        if files.is_in_use(self.path):
            raise self.fail(
                f"file_name {self.param.file_name!r} is read by a net; write to another file",
                "file_name",
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for name, x in zip(self.spec.bottom, bottom):
            if len(x.shape) > 4:
                raise self.fail(f"bottom {name!r} {x.shape} has more than four axes")
        if bottom[0].num != bottom[1].num:
            names = self.spec.bottom
            raise self.fail(
                f"bottoms {names[0]!r} {bottom[0].shape} and {names[1]!r} "
                f"{bottom[1].shape} must have the same number of items"
            )

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        if self.written:
            raise self.fail(
                f"{self.path} holds the batch of the first forward; as in Caffe, it writes only one: "
                "run one iteration, with a batch of all items",
                "file_name",
            )
        with (
            reading.refused(self.path, "the HDF5 file", verb="write"),
            hdf5.created(self.path) as file,
        ):
            for name, x in zip(NAMES, bottom):
                file[name] = x.data.reshape(x.num, x.channels, x.height, x.width)
        self.written = True
