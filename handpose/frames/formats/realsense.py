"""A connected RealSense camera, through pyrealsense2.

with open_live(None, CameraInfo()) as recording:    # or a camera's serial number
    for frame in recording: ...

Tested with pyrealsense2's software device, not with a real camera.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from handpose.frames.cameras import Camera
from handpose.frames.lens import lens_of
from handpose.frames.live import DeviceFrame, LiveRecording
from handpose.frames.recording import CameraInfo, Recording
from netlib.errors import DataError, NetlibError, reason_of

WAIT_MS = 1000


def open_live(serial: str | None, given: CameraInfo) -> Recording:
    """The depth stream of a connected camera, by serial number or any, in its default
    size and rate.

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
        wanted = f"camera {serial}" if serial else "a camera"
        connected = ", ".join(_connected(rs)) or "none"
        raise DataError(
            f"realsense: {wanted} cannot be started: {reason_of(error)}; connected: {connected} "
            "(no other program may use it)"
        ) from error
    with contextlib.ExitStack() as stack:
        stack.callback(pipeline.stop)  # if its parameters cannot be read
        name = _name_of(rs, profile.get_device())
        info = _info(rs, profile, name)
        stack.pop_all()
    return LiveRecording(_Device(name, info, pipeline), given)


def _name_of(rs: Any, device: Any) -> str:
    """The model and the serial number."""
    keys = (rs.camera_info.name, rs.camera_info.serial_number)
    return " ".join(str(device.get_info(key)) for key in keys)


def _library() -> Any:
    try:
        import pyrealsense2
    except ModuleNotFoundError as error:
        raise NetlibError("pyrealsense2 is missing: pip install pyrealsense2") from error
    except ImportError as error:  # its wheels leave out the system's libusb
        advice = ": apt install libusb-1.0-0" if "libusb" in str(error) else ""
        raise NetlibError(f"pyrealsense2 cannot be loaded: {reason_of(error)}{advice}") from error
    return pyrealsense2


def _connected(rs: Any) -> list[str]:
    """The serial numbers of all cameras."""
    with contextlib.suppress(RuntimeError):
        return [
            str(device.get_info(rs.camera_info.serial_number))
            for device in rs.context().query_devices()
        ]
    return []


def _info(rs: Any, profile: Any, name: str) -> CameraInfo:
    """The camera's own parameters. Raises DataError."""
    stream = profile.get_stream(rs.stream.depth).as_video_stream_profile()
    if stream.format() != rs.format.z16:
        raise DataError(f"{name}: its depth comes as {stream.format()}; expected z16")
    own = stream.get_intrinsics()
    lens = lens_of(str(own.model), own.coeffs, name)
    try:
        camera = Camera(name, own.fx, own.fy, own.ppx, own.ppy, own.width, own.height)
    except ValueError as error:  # it is not calibrated
        raise DataError(f"{name}: {error}") from None
    metres = profile.get_device().first_depth_sensor().get_depth_scale()
    unit_mm = float(f"{1000 * metres:.6g}")  # 0.001 as a float of 32 bits is not 0.001
    return CameraInfo(camera, lens, unit_mm, float(stream.fps()), name)


class _Device:
    """A started pipeline, which keeps the newest frame only.

    The camera's frame number includes dropped frames.
    """

    def __init__(self, name: str, info: CameraInfo, pipeline: Any) -> None:
        self.name, self.info, self._pipeline = name, info, pipeline

    def read(self) -> DeviceFrame | None:
        try:
            frame = self._pipeline.wait_for_frames(WAIT_MS).get_depth_frame()
        except RuntimeError as error:
            raise TimeoutError(reason_of(error)) from error
        if not frame:
            return None
        time = frame.get_timestamp() / 1000
        clock = frame.get_frame_timestamp_domain()
        return DeviceFrame(
            time, np.asanyarray(frame.get_data()), int(frame.get_frame_number()), clock
        )

    def close(self) -> None:
        with contextlib.suppress(RuntimeError):  # it has been stopped, or unplugged
            self._pipeline.stop()
