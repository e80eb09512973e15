"""The interface of all sources of depth frames, and what they share: parameters, and depth from
stored values.

with open_recording("my_frames") as recording:     # handpose.frames.formats
    for frame in recording:
        frame.time, frame.depth              # s; (height, width) in mm, 0 where there is no reading

What is known of its camera is ``CameraInfo``: from the user, the file itself, or a camera.json, by
order of precedence.

    decode = DepthDecoder(raw.shape, raw.dtype, "take.bag", given, own, camera_json)
    decode(raw)                                    # (height, width) in mm
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import CAMERAS, UNIT_MM, VIEWS, Camera, View
from handpose.frames.lens import Lens, Undistorter
from netlib.errors import DataError
from netlib.files.reading import located

RATE = 30.0  # frames per second, if unknown
# the remark about it
RATE_UNKNOWN = f"rate unknown: {RATE:g} frames per second assumed; --rate if that is wrong"
MAX_UINT16 = 65535  # maximum of 16 bits


class NotDepthError(DataError):
    """The values of a file are whole, and cannot be depths."""


class DepthFrame(NamedTuple):
    """One frame without lens distortion.

    number  0-based, among all frames of the recording
    time    s, by the source's clock, from its first frame on; ascends
    depth   (height, width) mm, 0 where there is no reading
    """

    number: int
    time: float
    depth: NDArray[np.float32]


class Recording(ABC):
    """Frames of one depth camera in the order of time.

    Iterating reads them one by one; raises DataError.

    A recording that ends within a frame yields all complete frames before it; then
    ``cut`` is not empty.

    name     for messages
    camera   of the frames, without distortion, with the frames' size
    unit_mm  depth of a stored value of 1
    count    number of frames, or None if unknown
    rate     nominal frames per second, or None
    live     True for a camera: frames that are not read in time are lost
    cut      after the last frame: the reason why there are fewer than expected, else empty
    remarks  assumptions about the source, and after the last frame what was left out, one line each
    warnings  what was found in the source and is not used, one line each
    """

    name: str
    camera: Camera
    unit_mm: float
    count: int | None = None
    rate: float | None = None
    live: bool = False
    cut: str = ""
    remarks: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @abstractmethod
    def __iter__(self) -> Iterator[DepthFrame]:
        """The frames from the first on; of a live one, from now on."""

    def _decode_by(self, decode: DepthDecoder) -> None:
        """Take a decoder of the frames, and their parameters from it."""
        self._decode = decode
        self.camera, self.unit_mm = decode.camera, decode.unit_mm
        self.rate, self.remarks = decode.rate, decode.remarks

    def _assume_rate(self) -> None:
        """Assume a rate for frames without times, unless it is known."""
        if self.rate is None:
            self.rate = RATE
            self.remarks += (RATE_UNKNOWN,)

    def close(self) -> None:  # noqa: B027  # most have nothing to let go of
        """Close files and cameras."""

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


@dataclass(frozen=True)
class CameraInfo:
    """Camera parameters; None is unknown.

    A camera whose width and height are 0 accepts frames of any size, and a ``View`` becomes a
    camera with their size.

    camera      of the frames
    lens        its distortion
    unit_mm     depth of a stored value of 1
    rate        frames per second
    origin      of these values, for messages: "--camera", "camera.json"
    time_unit   of the times in file names and arrays: "s", "ms", "us", "100ns" or "ns";
                "frames" if they count frames
    doubt       why files near the frames that may have a camera were not used, for messages
    """

    camera: Camera | View | None = None
    lens: Lens | None = None
    unit_mm: float | None = None
    rate: float | None = None
    origin: str = ""
    time_unit: str | None = None
    doubt: str = ""

    def or_else(self, other: CameraInfo) -> CameraInfo:
        """These parameters; those of ``other`` where these are unknown."""
        unknown = {
            name: value for name, value in vars(other).items() if getattr(self, name) in (None, "")
        }
        if self.camera is not None:  # camera and lens come from the same origin
            unknown.pop("lens", None)
        return replace(self, **unknown)


UNKNOWN = CameraInfo()


# ------------------------------------------------------------------------------------ stored values


class DepthDecoder:
    """The parameters of frames of a shape and type, which convert stored values to depth.

    They come from the user (``given``), else from the file itself, else from a camera.json.

    camera   of the frames, with their size
    lens     None without distortion
    unit_mm  depth of a stored value of 1
    where    name of the recording, for messages
    rate     frames per second, or None
    remarks  assumed values, and the origin of the others, one line each

    Raises DataError for an invalid lens, and if the camera is unknown, or the unit of numbers that
    may be metres.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: np.dtype[Any],
        where: str,
        given: CameraInfo,
        own: CameraInfo = UNKNOWN,
        camera_json: CameraInfo = UNKNOWN,
    ) -> None:
        check_values(dtype, where)
        known = given.or_else(own).or_else(camera_json)
        for name in ("unit_mm", "rate"):
            value = getattr(known, name)
            if value is not None and not 0 < value < np.inf:
                raise DataError(f"{where}: {name} is {value}; expected a number more than 0")
        if known.camera is None:
            raise _unknown_camera(known, where)
        self.where = where
        try:
            self.camera = sized(known.camera, shape, where)
        except DataError as error:
            by = f", by {camera_json.origin}" if known.camera is camera_json.camera else ""
            raise DataError(f"{error}{by}") from None
        self.lens = known.lens
        self.rate = known.rate
        remarks: list[str] = []
        if isinstance(known.camera, View) and known.lens is None:
            remarks.append(
                f"camera {known.camera.name}: focal lengths {self.camera.fx:.0f}, {self.camera.fy:.0f} px "
                "by the field of view alone, often 5% off; the intrinsics from the SDK are better"
            )
        elif own.camera is None:
            origin = given.origin if given.camera else camera_json.origin
            remarks.append(f"camera {known.camera.name}{origin and f', by {origin}'}")
        unit = _unit_of(known, dtype, where)
        if unit is None:
            unit = 1.0
            remarks.append(
                "unit unknown: a value of 1 is taken for 1 mm; --unit MM if that is wrong"
            )
        self.unit_mm = unit
        self._undistort = None
        if known.lens is not None and not known.lens.is_straight:
            with located(where):
                self._undistort = Undistorter(self.camera, known.lens)
            remarks.append("the distortion of the lens is taken out")
        # the user gave a camera without a lens
        elif own.lens is not None and not own.lens.is_straight:
            remarks.append(
                f"the distortion in {where} is of another camera and is not removed; --distortion "
                "if it holds for this one"
            )
        self.remarks = tuple(remarks)

    def __call__(self, raw: NDArray[Any], where: str = "") -> NDArray[np.float32]:
        """Depth (height, width) in mm for stored values of the same shape; 0 without a
        reading, and for NaN.

        ``where`` is the name of this frame. Raises DataError for values that cannot be depths, and
        for another size.
        """
        where = where or self.where
        check_values(raw.dtype, where)
        if raw.shape != (self.camera.height, self.camera.width):
            raise DataError(
                f"{where}: {size_of(raw.shape)}; the camera has "
                f"{self.camera.width} x {self.camera.height}"
            )
        with np.errstate(all="ignore"):  # numbers beyond float32's range become infinite
            depth = raw.astype(np.float32) * np.float32(self.unit_mm)
        if raw.dtype.kind == "f":
            depth[~np.isfinite(depth)] = 0  # ROS has NaN, and infinities for too near and too far
        if raw.dtype.kind != "u" and depth.min(initial=0) < 0:
            raise DataError(
                f"{where}: a depth of {depth.min():g} mm; expected 0 where nothing was read, else more"
            )
        return depth if self._undistort is None else self._undistort(depth)


def _unknown_camera(known: CameraInfo, where: str) -> DataError:
    found = known.doubt and f" (not used: {known.doubt})"
    return DataError(
        f"{where}: the camera of these frames is unknown{found}; give --camera FILE with its "
        "intrinsics from the SDK (also as camera.json next to the frames), or FX,FY,U0,V0, or a "
        f"model, {', '.join((*CAMERAS, *VIEWS))}, or --fov DEGREES, its horizontal field of view"
    )


def _unit_of(known: CameraInfo, dtype: np.dtype[Any], where: str) -> float | None:
    """The unit in mm of stored values; None if it is unknown.

    Raises DataError if it is unknown and may be metres.
    """
    if known.unit_mm is not None:
        return known.unit_mm
    if dtype.kind == "f":
        raise DataError(
            f"{where}: {dtype} depth of unknown unit; give --unit 1 for mm, --unit 1000 for "
            'metres, or write "unit_mm" into a camera.json next to it'
        )
    camera = known.camera
    if isinstance(camera, Camera) and CAMERAS.get(camera.name) == camera:
        return UNIT_MM.get(camera.name, 1.0)
    return None


def stored(depth: NDArray[np.float32], unit_mm: float, where: str) -> NDArray[np.uint16]:
    """16-bit values for depth in mm: the inverse of a DepthDecoder without a lens.

    Raises DataError for depths beyond 16 bits, which would change.
    """
    values = np.rint(depth.astype(np.float64) / unit_mm)
    if not (values.min(initial=0) >= 0 and values.max(initial=0) <= MAX_UINT16):
        raise DataError(
            f"{where}: depth from {depth.min():g} to {depth.max():g} mm does not fit into 16 bits of "
            f"{unit_mm:g} mm; expected 0 to {MAX_UINT16 * unit_mm:g}, or take a larger unit"
        )
    return values.astype(np.uint16)


def sized(camera: Camera | View, shape: tuple[int, ...], where: str) -> Camera:
    """The camera with the size of its frames, if it has none.

    Raises DataError if it has another.
    """
    if len(shape) != 2 or 0 in shape:
        raise DataError(f"{where}: frames of shape {shape}, expected (height, width)")
    height, width = shape
    if isinstance(camera, View):
        with located(where):
            return camera.at(width, height)
    if not camera.width:
        return replace(camera, width=width, height=height)
    if (camera.width, camera.height) != (width, height):
        raise DataError(
            f"{where}: {size_of(shape)}{_scaled(camera, width, height)}; camera {camera.name} has "
            f"{camera.width} x {camera.height}"
        )
    return camera


def _scaled(camera: Camera, width: int, height: int) -> str:
    """The option for images of a camera in another size, if it has the same shape; else empty."""
    if camera.width * height != camera.height * width:
        return ""
    scale = width / camera.width
    focal = (camera.fx * scale, camera.fy * scale)
    middle = ((at + 0.5) * scale - 0.5 for at in (camera.u0, camera.v0))
    four = ",".join(f"{number:.6g}" for number in (*focal, *middle))
    return f" (if they are the whole image in this size: --camera {four})"


def check_values(dtype: np.dtype[Any], where: str) -> None:
    """Raise NotDepthError unless values of this type can be depths."""
    if dtype.kind not in "uif" or dtype.itemsize < 2:
        raise NotDepthError(f"{where}: values of type {dtype}; expected depths, of 16 bits or more")


def size_of(shape: tuple[int, ...]) -> str:
    """A size in words, width first."""
    return f"{shape[1]} x {shape[0]} pixels" if len(shape) == 2 else f"shape {shape}"
