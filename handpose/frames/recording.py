"""The interface of all sources of depth frames.

with open_recording("my_frames") as recording:     # handpose.frames.formats
    for frame in recording:
        frame.time, frame.depth                    # s; (height, width) in mm, 0 where there is no reading

What is known of its camera, from the user, the file itself, or a camera.json, is ``CameraInfo``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera, View
from handpose.frames.lens import Lens


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
    """Frames of one depth camera in the order of time. Iterating reads them one by one; raises DataError.

    A recording that ends within a frame yields all complete frames before it; then ``cut`` is not empty.

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

    def close(self) -> None:  # noqa: B027  # most have nothing to let go of
        """Close files and cameras."""

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()


@dataclass(frozen=True)
class CameraInfo:
    """Camera parameters; None is unknown. A camera whose width and height are 0 accepts frames of any size, and a
    ``View`` becomes a camera with their size.

    camera      of the frames
    lens        its distortion
    unit_mm     depth of a stored value of 1
    rate        frames per second
    origin      of these values, for messages: "--camera", "camera.json"
    time_unit   of the times in file names and arrays: "s", "ms", "us" or "ns"; "frames" if they count frames
    """

    camera: Camera | View | None = None
    lens: Lens | None = None
    unit_mm: float | None = None
    rate: float | None = None
    origin: str = ""
    time_unit: str | None = None

    def or_else(self, other: CameraInfo) -> CameraInfo:
        """These parameters; those of ``other`` where these are unknown."""
        unknown = {name: value for name, value in vars(other).items() if getattr(self, name) in (None, "")}
        if self.camera is not None:  # camera and lens come from the same origin
            unknown.pop("lens", None)
        return replace(self, **unknown)


UNKNOWN = CameraInfo()
