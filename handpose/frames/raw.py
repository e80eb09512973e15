"""From stored values to depth, for all sources: unit, holes, size, lens.

decode = decoder_of(given, own, camera_json, raw.shape, raw.dtype, "take.bag")   # by order of precedence
decode(raw)                                                                      # (height, width) mm
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import CAMERAS, UNIT_MM, VIEWS, Camera, View
from handpose.frames.lens import Lens, Undistorter
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError

RATE = 30.0  # frames per second, if unknown
MAX_UINT16 = 65535  # maximum of 16 bits
HEADERLESS = (  # about .raw files
    "values without a header, as rs-convert -r and the RealSense Viewer write them. Write PNG instead (rs-convert -p), "
    "or convert them, with their height and width: python -c \"import glob, numpy as np; np.save('take.npy', "
    "[np.fromfile(name, '<u2').reshape(480, 640) for name in sorted(glob.glob('*.raw'))])\""
)


class DepthDecoder:
    """The parameters of a recording, which convert its stored frames to depth. Raises DataError for an invalid lens.

    camera   of the frames, with their size
    lens     None without distortion
    unit_mm  depth of a stored value of 1
    where    name of the recording, for messages
    rate     frames per second, or None
    remarks  assumed values, and the origin of the others, one line each
    """

    def __init__(
        self, camera: Camera, lens: Lens | None, unit_mm: float, where: str, rate: float | None = None,
        remarks: tuple[str, ...] = (),
    ) -> None:
        self.camera, self.lens, self.unit_mm, self.where = camera, lens, unit_mm, where
        self.rate, self.remarks = rate, remarks
        self._unit = np.float32(unit_mm)
        try:
            self._undistort = None if lens is None or lens.is_straight else Undistorter(camera, lens)
        except DataError as error:
            raise DataError(f"{where}: {error}") from None

    def __call__(self, raw: NDArray[Any], where: str = "") -> NDArray[np.float32]:
        """Depth (height, width) in mm for stored values of the same shape; 0 without a reading, and for NaN.

        ``where`` is the name of this frame. Raises DataError for values that cannot be depths, and for another size.
        """
        where = where or self.where
        check_values(raw.dtype, where)
        if raw.shape != (self.camera.height, self.camera.width):
            raise DataError(f"{where}: {size_of(raw.shape)}; the camera has "
                            f"{self.camera.width} x {self.camera.height}")
        with np.errstate(all="ignore"):  # numbers beyond float32's range become infinite
            depth = raw.astype(np.float32) * self._unit
        if raw.dtype.kind == "f":
            depth[~np.isfinite(depth)] = 0  # ROS has NaN, and infinities for too near and too far
        if raw.dtype.kind != "u" and depth.min(initial=0) < 0:
            raise DataError(f"{where}: a depth of {depth.min():g} mm; expected 0 where nothing was read, else more")
        return depth if self._undistort is None else self._undistort(depth)

    def paced(self) -> tuple[float, tuple[str, ...]]:
        """Frames per second for frames without times, and a remark about it."""
        if self.rate is not None:
            return self.rate, ()
        return RATE, (f"rate unknown: {RATE:g} frames per second assumed; --rate if that is wrong",)


def stored(depth: NDArray[np.float32], unit_mm: float, where: str) -> NDArray[np.uint16]:
    """16-bit values for depth in mm: the inverse of a DepthDecoder without a lens.

    Raises DataError for depths beyond 16 bits, which would change.
    """
    values = np.rint(depth.astype(np.float64) / unit_mm)
    if not (values.min(initial=0) >= 0 and values.max(initial=0) <= MAX_UINT16):
        raise DataError(f"{where}: depth from {depth.min():g} to {depth.max():g} mm does not fit into 16 bits of "
                        f"{unit_mm:g} mm; expected 0 to {MAX_UINT16 * unit_mm:g}, or take a larger unit")
    return values.astype(np.uint16)


def decoder_of(
    given: CameraInfo, own: CameraInfo, camera_json: CameraInfo, shape: tuple[int, ...], dtype: np.dtype[Any],
    where: str,
) -> DepthDecoder:
    """The decoder of frames of a shape and type: parameters from the user, else the file itself, else a camera.json.

    Raises DataError if the camera is unknown, or the unit of numbers that may be metres.
    """
    check_values(dtype, where)
    known = given.or_else(own).or_else(camera_json)
    if known.camera is None:
        raise DataError(f"{where}: the camera of these frames is unknown; give --camera FILE with its intrinsics from "
                        "the SDK (also as camera.json next to the frames), or FX,FY,U0,V0, or a model, "
                        f"{', '.join((*CAMERAS, *VIEWS))}, or --fov DEGREES, its horizontal field of view")
    remarks = []
    camera = sized(known.camera, shape, where)
    if isinstance(known.camera, View) and known.lens is None:
        remarks.append(f"camera {known.camera.name}: focal lengths {camera.fx:.0f}, {camera.fy:.0f} px by the field of "
                       "view alone, often 5% off; the intrinsics from the SDK are better")
    elif own.camera is None:
        remarks.append(f"camera {known.camera.name}, by {given.origin if given.camera else camera_json.origin}")
    unit = known.unit_mm
    if unit is None and dtype.kind != "f" and CAMERAS.get(known.camera.name) == known.camera:
        unit = UNIT_MM.get(known.camera.name, 1.0)
    if unit is None:
        if dtype.kind == "f":
            raise DataError(f"{where}: {dtype} depth of unknown unit; give --unit 1 for mm, --unit 1000 for metres, or "
                            'write "unit_mm" into a camera.json next to it')
        unit = 1.0
        remarks.append("unit unknown: a value of 1 is taken for 1 mm; --unit MM if that is wrong")
    if known.lens is not None and not known.lens.is_straight:
        remarks.append("the distortion of the lens is taken out")
    elif own.lens is not None and not own.lens.is_straight:  # the user gave a camera without a lens
        remarks.append(f"the distortion in {where} is of another camera and is not removed; --distortion "
                       "if it holds for this one")
    return DepthDecoder(camera, known.lens, unit, where, known.rate, tuple(remarks))


def sized(camera: Camera | View, shape: tuple[int, ...], where: str) -> Camera:
    """The camera with the size of its frames, if it has none. Raises DataError if it has another."""
    if len(shape) != 2 or 0 in shape:
        raise DataError(f"{where}: frames of shape {shape}, expected (height, width)")
    height, width = shape
    if isinstance(camera, View):
        try:
            return camera.at(width, height)
        except DataError as error:
            raise DataError(f"{where}: {error}") from None
    if not camera.width:
        return replace(camera, width=width, height=height)
    if (camera.width, camera.height) != (width, height):
        raise DataError(f"{where}: {size_of(shape)}; camera {camera.name} has {camera.width} x {camera.height}")
    return camera


def check_values(dtype: np.dtype[Any], where: str) -> None:
    """Raise DataError unless values of this type can be depths."""
    if dtype.kind not in "uif" or dtype.itemsize < 2:
        raise DataError(f"{where}: values of type {dtype}; expected depths, of 16 bits or more")


def size_of(shape: tuple[int, ...]) -> str:
    """A size in words, width first."""
    return f"{shape[1]} x {shape[0]} pixels" if len(shape) == 2 else f"shape {shape}"
