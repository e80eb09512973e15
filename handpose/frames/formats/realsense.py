"""A connected RealSense camera, through pyrealsense2.

with open_live(None, CameraInfo()) as recording:    # or a camera's serial number
    for frame in recording: ...

Tested with pyrealsense2's software device, not with a real camera.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from handpose.frames.cameras import Camera
from handpose.frames.lens import lens_of
from handpose.frames.raw import Calibration, calibration_of
from handpose.frames.recording import UNKNOWN, CameraInfo, DepthFrame, Recording
from netlib.errors import DataError, NetlibError, reason_of

WAIT_MS, WAITS = 1000, 5  # Ctrl-C is handled after each; a starting camera may need a few seconds


def open_live(serial: str | None, given: CameraInfo) -> Recording:
    """The depth stream of a connected camera, by serial number or any, in its default size and rate.

    Raises DataError if there is none, and NetlibError without pyrealsense2.
    """
    rs = _library()
    config = rs.config()
    if serial:
        config.enable_device(serial)
    config.enable_stream(rs.stream.depth)
    pipeline = rs.pipeline()
    try:
        profile = pipeline.start(config)
    except RuntimeError as error:
        raise DataError(f"realsense: {f'camera {serial}' if serial else 'a camera'} cannot be started: "
                        f"{reason_of(error)}; connected: {', '.join(_connected(rs)) or 'none'} (no other program may "
                        "use it)") from error  # fmt: skip
    with contextlib.ExitStack() as stack:
        stack.callback(pipeline.stop)
        device = profile.get_device()
        name = f"{device.get_info(rs.camera_info.name)} {device.get_info(rs.camera_info.serial_number)}"
        own, shape = _own(rs, profile, name)
        live = _Live(name, calibration_of(given, own, UNKNOWN, shape, np.dtype(np.uint16), name), pipeline)
        stack.pop_all()
    return live


def _library() -> Any:
    try:
        import pyrealsense2
    except ModuleNotFoundError as error:
        raise NetlibError("pyrealsense2 is missing: pip install pyrealsense2") from error
    except ImportError as error:  # its wheels leave out the system's libusb
        raise NetlibError(f"pyrealsense2 cannot be loaded: {reason_of(error)}"
                          f"{': apt install libusb-1.0-0' if 'libusb' in str(error) else ''}") from error  # fmt: skip
    return pyrealsense2


def _connected(rs: Any) -> list[str]:
    """The serial numbers of all cameras."""
    with contextlib.suppress(RuntimeError):
        return [str(device.get_info(rs.camera_info.serial_number)) for device in rs.context().query_devices()]
    return []


def _own(rs: Any, profile: Any, name: str) -> tuple[CameraInfo, tuple[int, int]]:
    """The camera's own parameters, and the height and width of its frames. Raises DataError."""
    stream = profile.get_stream(rs.stream.depth).as_video_stream_profile()
    if stream.format() != rs.format.z16:
        raise DataError(f"{name}: its depth comes as {stream.format()}; expected z16")
    said = stream.get_intrinsics()
    lens = lens_of(str(said.model), said.coeffs, name)
    try:
        camera = Camera(name, said.fx, said.fy, said.ppx, said.ppy, said.width, said.height)
    except ValueError as error:  # not calibrated
        raise DataError(f"{name}: {error}") from None
    metres = profile.get_device().first_depth_sensor().get_depth_scale()
    unit_mm = float(f"{1000 * metres:.6g}")  # 0.001 as a float of 32 bits is not 0.001
    return CameraInfo(camera, lens, unit_mm, float(stream.fps()), name), (said.height, said.width)


class _Live(Recording):
    """Frames as they come. The camera's frame number includes frames dropped because they were not read in time."""

    live = True

    def __init__(self, name: str, calibration: Calibration, pipeline: Any) -> None:
        self.name, self.camera, self.unit_mm, self.rate = (
            name,
            calibration.camera,
            calibration.unit_mm,
            calibration.rate,
        )
        self.remarks = self._assumed = calibration.remarks
        self._decode, self._pipeline = calibration.decoder(name), pipeline

    def __iter__(self) -> Iterator[DepthFrame]:
        self.cut, self.remarks = "", self._assumed
        clock = _CameraClock(1 / (self.rate or 30))
        last, lost = -1, 0
        before: int | None = None
        try:
            while (frame := self._next()) is not None:
                counted = int(frame.get_frame_number())
                step = 1 if before is None or counted < before else counted - before
                before = counted
                if step == 0:  # the same frame again
                    continue
                last, lost = last + step, lost + step - 1
                time = clock(frame.get_timestamp(), frame.get_frame_timestamp_domain())
                yield DepthFrame(last, time, self._decode(np.asanyarray(frame.get_data())))
        finally:
            if lost:
                self.remarks += (f"frames lost because they were not taken in time: {lost}",)

    def _next(self) -> Any:
        """The next frame; None if none comes, and then ``cut`` is the reason."""
        reason = ""
        for _ in range(WAITS):
            try:
                if depth := self._pipeline.wait_for_frames(WAIT_MS).get_depth_frame():
                    return depth
            except RuntimeError as error:
                reason = reason_of(error)
        self.cut = f"no frame for {WAITS * WAIT_MS / 1000:g} s; was the camera unplugged? ({reason})"
        return None

    def close(self) -> None:
        """Stop the camera."""
        with contextlib.suppress(RuntimeError):  # it has been stopped, or unplugged
            self._pipeline.stop()


class _CameraClock:
    """Seconds since the first frame. If the camera changes to another clock, one frame's time is assumed to pass."""

    def __init__(self, step: float) -> None:
        self._step = step
        self._domain: Any = None
        self._begin = self._last = -step

    def __call__(self, time_ms: float, domain: Any) -> float:
        seconds = time_ms / 1000
        if domain != self._domain or seconds - self._begin <= self._last:
            self._domain, self._begin = domain, seconds - (self._last + self._step)
        self._last = seconds - self._begin
        return self._last
