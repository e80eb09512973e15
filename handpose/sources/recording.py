"""What every source of depth frames is, whatever file or camera it comes from.

with open_recording("my_frames") as recording:     # handpose.sources.opening
    for frame in recording:
        frame.time, frame.depth                    # s; (height, width) in mm, 0 where nothing was read
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.facts.cameras import Camera


class DepthFrame(NamedTuple):
    """One frame, as a camera without distortion sees it.

    number  0-based, among all frames of the recording
    time    s, by the source's clock, from its first frame on; ascends
    depth   (height, width) mm, 0 where nothing was read
    """

    number: int
    time: float
    depth: NDArray[np.float32]


class Recording(ABC):
    """Frames of one depth camera, in the order of time. Iterating reads them one by one; raises DataError.

    A recording that ends in the middle of a frame gives all whole frames before it; then ``cut`` says so.

    name     what messages call it
    camera   that saw the frames, without distortion, and with the frames' size
    unit_mm  what a stored value of 1 stands for
    count    how many frames there are, if that is known
    rate     frames per second that the source promises, if it does
    live     do frames come as they are seen? Then those that nobody took in time are lost
    cut      after the last frame: why there are not all that were promised, else empty
    remarks  what was assumed of the source, and after the last frame what was left out of it: a line each
    """

    name: str
    camera: Camera
    unit_mm: float
    count: int | None = None
    rate: float | None = None
    live: bool = False
    cut: str = ""
    remarks: tuple[str, ...] = ()

    @abstractmethod
    def __iter__(self) -> Iterator[DepthFrame]:
        """The frames from the first on; of a live one, from now on."""

    def close(self) -> None:  # noqa: B027  # most have nothing to let go of
        """Let go of files and cameras."""

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()
