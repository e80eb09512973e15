"""Live cameras: one small interface for their SDKs, and a recording of the frames as they come.

with open_device(MyDevice()) as recording:     # any object with the members of Device
    for frame in recording: ...
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator
from numbers import Real
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera
from handpose.frames.recording import RATE, UNKNOWN, CameraInfo, DepthDecoder, DepthFrame, Recording
from netlib.errors import DataError, NetlibError, reason_of

WAIT_S, WAITS = 1.0, 5  # Ctrl-C is handled after each; a starting camera may need a few seconds


class DeviceFrame(NamedTuple):
    """One frame of a device.

    time    s by any clock of the device
    values  (height, width) stored values, valid until the next call of ``read``
    number  by the device's count of all frames, including those that were not read;
            None without one
    clock   which clock ``time`` is of, if the device has several
    """

    time: float
    values: NDArray[Any]
    number: int | None = None
    clock: object = None


class Device(Protocol):
    """A connected depth camera.

    name  for messages
    info  its parameters; ``camera`` has the frames' size, and ``unit_mm`` is known
    """

    name: str
    info: CameraInfo

    def read(self) -> DeviceFrame | None:
        """The next frame; None, or TimeoutError with the reason, if none comes within
        about a second.

        Raises EOFError after the last frame of a device that ends; other exceptions mean that
        it has failed.
        """

    def close(self) -> None:
        """Stop the camera."""


class CaptureThread:
    """A device whose frames a thread reads as they come.

    Only the newest is kept: where an SDK queues frames, this keeps those that are returned recent,
    however long their reader takes. Frames of a device without a count are counted here.
    """

    def __init__(self, device: Device) -> None:
        self.name = device.name
        self.info = device.info
        self._device = device
        self._changed = threading.Condition()
        self._newest: DeviceFrame | None = None
        self._failure: Exception | None = None
        self._is_closed = False
        self._thread: threading.Thread | None = None

    def _capture(self) -> None:
        """Read frames until the device ends, fails or is closed."""
        count = 0
        failure: Exception | None = None
        while not self._is_closed and (failure is None or isinstance(failure, TimeoutError)):
            frame, failure = self._next(count)
            if frame is None and failure is None:
                continue
            with self._changed:
                self._failure = failure
                if frame is not None:
                    count += 1
                    self._newest = frame
                self._changed.notify()

    def _next(self, count: int) -> tuple[DeviceFrame | None, Exception | None]:
        """The next frame of the device, if there is one, or its exception.

        count  the number of a frame without one
        """
        try:
            frame = self._device.read()
            if frame is None:
                return None, None
            number = count if frame.number is None else frame.number
            return frame._replace(values=np.array(frame.values), number=number), None
        except Exception as error:  # of any SDK; it is raised where the frames are read
            return None, error

    def read(self) -> DeviceFrame | None:
        """The newest frame that was not returned yet; the device's exceptions after its last frame.

        The first call starts the thread.
        """
        if self._thread is None:
            self._thread = threading.Thread(
                target=self._capture, name=f"capture {self.name}", daemon=True
            )
            self._thread.start()
        with self._changed:
            self._changed.wait_for(
                lambda: self._newest is not None or self._failure is not None, WAIT_S
            )
            frame, self._newest, failure = self._newest, None, self._failure
            if frame is None and failure is not None:
                self._failure = None if isinstance(failure, TimeoutError) else failure
                raise failure
            return frame

    def close(self) -> None:
        """End the thread, then close the device."""
        self._is_closed = True
        if self._thread is not None:
            self._thread.join()
        self._device.close()


def open_device(device: Device, given: CameraInfo = UNKNOWN) -> LiveRecording:
    """The frames of a device, read by a thread; ``given`` replaces its own parameters.

    Raises DataError.
    """
    return LiveRecording(CaptureThread(device), given)


class LiveRecording(Recording):
    """Frames as they come.

    Numbers count all frames of the device, so those that were dropped are missing.

    If a device's clock restarts or changes, the rate gives the time that passed. The device is
    closed with the recording, and if its parameters are not valid: DataError.
    """

    live = True

    def __init__(self, device: Device, given: CameraInfo = UNKNOWN) -> None:
        self.name = device.name
        self._device = device
        with contextlib.ExitStack() as stack:
            stack.callback(device.close)
            camera = device.info.camera
            if not isinstance(camera, Camera) or not camera.width or device.info.unit_mm is None:
                raise DataError(
                    f"{device.name}: expected the camera with its width and height, and unit_mm"
                )
            shape = (camera.height, camera.width)
            self._decode_by(DepthDecoder(shape, np.dtype(np.uint16), self.name, given, device.info))
            stack.pop_all()

    def __iter__(self) -> Iterator[DepthFrame]:
        self.cut = ""
        self.remarks = self._decode.remarks
        clock = _Clock(1 / (self.rate or RATE))
        number = -1
        lost = 0
        before: int | None = None  # the number of the last frame by the device's count
        try:
            while (frame := self._next()) is not None:
                counted = number + 1 if frame.number is None else frame.number
                step = 1 if before is None or counted < before else counted - before
                before = counted
                if step == 0:  # the same frame again
                    continue
                number += step
                lost += step - 1
                if not isinstance(frame.time, Real) or not math.isfinite(frame.time):
                    raise DataError(f"{self.name}: a frame's time is {frame.time}; expected s")
                time = clock(frame.time, frame.clock, step)
                yield DepthFrame(number, time, self._decode(frame.values))
        finally:
            if lost:
                self.remarks += (f"frames lost because they were not taken in time: {lost}",)
            if clock.jumps:
                self.remarks += (
                    f"times of the device that are more than {WAITS * WAIT_S:g} s after the frame before, and not "
                    f"used: {clock.jumps}; expected s",
                )

    def _next(self) -> DeviceFrame | None:
        """The next frame; None if none comes, and then ``cut`` is the reason unless the
        device has ended.
        """
        reason = ""
        for _ in range(WAITS):
            try:
                if (frame := self._device.read()) is not None:
                    return frame
            except EOFError:
                return None
            except TimeoutError as error:
                reason = reason_of(error)
            except NetlibError:
                raise
            except Exception as error:  # of any SDK
                self.cut = f"the camera has stopped: {reason_of(error)}"
                return None
        self.cut = f"no frame for {WAITS * WAIT_S:g} s; was the camera unplugged?{reason and f' ({reason})'}"
        return None

    def close(self) -> None:
        """Stop the camera."""
        self._device.close()


class _Clock:
    """Seconds since the first frame.

    If a device changes to another clock, the rate gives the time that passed; also if this is more
    than a device may be silent for. Then its times may not be in s.

    jumps  number of such times
    """

    def __init__(self, step: float) -> None:
        self.jumps = 0
        self._step = step
        self._clock: object = None
        self._begin = self._last = -step

    def __call__(self, seconds: float, clock: object, frames: int) -> float:
        """The time in s of a frame that is ``frames`` frames after the last one."""
        passed = seconds - self._begin - self._last
        is_same = clock == self._clock and self._last >= 0
        is_jump = is_same and passed > frames * WAITS * WAIT_S
        self.jumps += is_jump
        if not is_same or is_jump or passed <= 0:
            self._clock = clock
            self._begin = seconds - (self._last + frames * self._step)
        self._last = seconds - self._begin
        return self._last
