""".npz files that ``stack`` reads back: depth (frames, height, width) uint16, time (frames,) s, camera as JSON."""

from __future__ import annotations

import contextlib
import shutil
import zipfile
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from handpose.facts.cameras import Camera
from handpose.sources import camera_file
from handpose.sources.raw import stored
from handpose.sources.recording import DepthFrame, Given
from netlib import files
from netlib.errors import DataError
from netlib.files import atomic

FASTEST = 1  # level of compression: a minute of frames takes seconds


class StackWriter:
    """Keeps frames in a hidden file next to ``path``, and writes ``path`` from them at the end, if there are any.

    Both need disk space. If there is not enough for the second, the frames are lost: there is no file, or the old one.
    Raises OSError.
    """

    def __init__(self, path: Path, camera: Camera, unit_mm: float, rate: float | None) -> None:
        self._path, self._camera, self._unit, self._rate = path, camera, unit_mm, rate
        self._times: list[float] = []
        with contextlib.ExitStack() as stack, atomic.error_names(path):
            files.make_folder(path.parent)
            self._kept = stack.enter_context(stack.enter_context(atomic.temporary(path)).open("w+b"))
            self._stack = stack.pop_all()

    def write(self, frame: DepthFrame) -> None:
        """Add a frame. Raises DataError, OSError."""
        where = f"{self._path}: frame {frame.number}"
        if self._times and frame.time <= self._times[-1]:
            raise DataError(f"{where}: at {frame.time:.6f} s, which is not after the frame before")
        values = stored(frame.depth, self._unit, where)
        with atomic.error_names(self._path):
            self._kept.write(values.astype("<u2").tobytes())
        self._times.append(frame.time)

    def discard(self) -> None:
        """Drop the frames so far, without writing a file."""
        self._times.clear()

    def close(self) -> None:
        """Make the file of all whole frames."""
        with self._stack:
            if self._times:
                atomic.replace(self._path, self._fill)

    def _fill(self, fresh: Path) -> None:
        shape = (len(self._times), self._camera.height, self._camera.width)
        said = camera_file.to_text(Given(self._camera, unit_mm=self._unit, rate=self._rate))
        with zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED, compresslevel=FASTEST) as archive:
            for name, small in (("time", np.array(self._times)), ("camera", np.array(said))):
                with archive.open(f"{name}.npy", "w") as out:
                    npy.write_array(out, small, allow_pickle=False)
            with archive.open("depth.npy", "w", force_zip64=True) as out:
                npy.write_array_header_1_0(out, {"descr": "<u2", "fortran_order": False, "shape": shape})
                self._kept.truncate(2 * shape[0] * shape[1] * shape[2])  # without an incomplete last frame
                self._kept.seek(0)
                shutil.copyfileobj(self._kept, out, 1 << 24)
