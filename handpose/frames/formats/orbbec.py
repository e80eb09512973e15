"""A connected Orbbec camera, such as Femto, Gemini and Astra, through pyorbbecsdk.

with open_live(None, CameraInfo()) as recording:    # or a camera's serial number
    for frame in recording: ...

Tested with a simulated device only. The package is pyorbbecsdk2, the Python interface of Orbbec's SDK 2.
"""

from __future__ import annotations

import contextlib
import sys
from typing import Any

import numpy as np

from handpose.frames.lens import Lens, lens_of
from handpose.frames.live import CaptureThread, DeviceFrame, LiveRecording, calibrated, first_of, not_started
from handpose.frames.recording import CameraInfo, Recording
from netlib.errors import DataError, NetlibError, reason_of

WAIT_MS = 1000
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
RATIONAL = "BROWN_CONRADY_K6"  # Orbbec's name of the model with all of them


def open_live(serial: str | None, given: CameraInfo) -> Recording:
    """The depth stream of a connected camera, by serial number or any, in its default size and rate.

    Raises DataError if there is none, and NetlibError without pyorbbecsdk.
    """
    ob = _library()
    try:
        devices = ob.Context().query_devices()
        pipeline = ob.Pipeline(devices.get_device_by_serial_number(serial)) if serial else ob.Pipeline()
        profile = pipeline.get_stream_profile_list(ob.OBSensorType.DEPTH_SENSOR).get_default_video_stream_profile()
        config = ob.Config()
        config.enable_stream(profile)
        pipeline.start(config)
    except (ob.OBError, RuntimeError) as error:
        raise not_started("orbbec", "camera", serial, error, _connected(ob)) from error
    with contextlib.ExitStack() as stack:
        stack.callback(pipeline.stop)
        about = pipeline.get_device().get_device_info()
        name = f"{about.get_name()} {about.get_serial_number()}"
        device = _Device(ob, name, pipeline, profile)
        stack.pop_all()
    return LiveRecording(CaptureThread(device), given)


def _library() -> Any:
    try:
        with contextlib.redirect_stdout(sys.stderr):  # it prints while it is imported
            import pyorbbecsdk
    except ImportError as error:
        raise NetlibError(f"pyorbbecsdk is missing: pip install pyorbbecsdk2 ({reason_of(error)})") from error
    return pyorbbecsdk


def _connected(ob: Any) -> list[str]:
    """The serial numbers of all cameras."""
    with contextlib.suppress(ob.OBError, RuntimeError):
        devices = ob.Context().query_devices()
        return [str(devices.get_device_serial_number_by_index(i)) for i in range(devices.get_count())]
    return []


class _Device:
    """A started pipeline. The first frame shows the depth unit; it is not returned. Raises DataError without one."""

    def __init__(self, ob: Any, name: str, pipeline: Any, profile: Any) -> None:
        self.name, self._ob, self._pipeline = name, ob, pipeline
        first = first_of(self._depth)
        if first is None:
            raise DataError(f"{name}: no frame of depth; is another program using it?")
        if first.get_format() not in (ob.OBFormat.Y16, ob.OBFormat.Z16):
            raise DataError(f"{name}: its depth comes as {first.get_format()}; expected Y16")
        said, self._shape = profile.get_intrinsic(), (first.get_height(), first.get_width())
        if (said.height, said.width) != self._shape:
            raise DataError(f"{name}: frames of {self._shape[1]} x {self._shape[0]} pixels; its camera has "
                            f"{said.width} x {said.height}")
        camera = calibrated(name, said.fx, said.fy, said.cx, said.cy, said.width, said.height)
        unit_mm = float(f"{first.get_depth_scale():.6g}")  # mm; 0.1 as a float of 32 bits is not 0.1
        self.info = CameraInfo(camera, _lens(profile.get_distortion(), name), unit_mm, float(profile.get_fps()), name)

    def _depth(self) -> Any:
        """The next frame of depth; None if there is none within a second."""
        frames = self._pipeline.wait_for_frames(WAIT_MS)
        return None if frames is None else frames.get_depth_frame()

    def read(self) -> DeviceFrame | None:
        try:
            frame = self._depth()
        except (self._ob.OBError, RuntimeError) as error:
            raise TimeoutError(reason_of(error)) from error
        if frame is None:
            return None
        values = np.frombuffer(frame.get_data(), np.uint16).reshape(self._shape)
        return DeviceFrame(frame.get_timestamp_us() / 1e6, values, int(frame.get_index()))

    def close(self) -> None:
        with contextlib.suppress(self._ob.OBError, RuntimeError):  # it has been stopped, or unplugged
            self._pipeline.stop()


def _lens(said: Any, name: str) -> Lens:
    """The lens of the SDK's distortion. Raises DataError."""
    model = said.model.name
    values = [float(getattr(said, key)) for key in COEFFICIENTS]
    return lens_of("BROWN_CONRADY" if model == RATIONAL else model, values if model == RATIONAL else values[:5], name)
