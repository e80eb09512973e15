"""A connected OAK-D camera of Luxonis, through depthai 3.

with open_live(None, CameraInfo()) as recording:    # or a device's identifier
    for frame in recording: ...

Depth is of the stereo pair, 640 x 400 pixels, with extended disparity, which halves the minimum range: a pair 75 mm
apart measures from 0.2 m instead of 0.35 m. Tested with a simulated device only.
"""

from __future__ import annotations

import contextlib
from datetime import timedelta
from typing import Any

import numpy as np

from handpose.frames.lens import Lens
from handpose.frames.live import WAIT_S, DeviceFrame, LiveRecording, calibrated, first_of, not_started
from handpose.frames.recording import CameraInfo, Recording
from netlib.errors import DataError, NetlibError, reason_of

SIZE, RATE = (640, 400), 30.0
UNIT_MM = 1.0  # StereoDepth's default


def open_live(serial: str | None, given: CameraInfo) -> Recording:
    """The stereo depth of a connected device, by its identifier or any.

    Raises DataError if there is none, and NetlibError without depthai 3.
    """
    dai = _library()
    with contextlib.ExitStack() as stack:
        try:
            board = dai.Device(dai.DeviceInfo(serial)) if serial else dai.Device()
            stack.callback(board.close)
            pipeline = dai.Pipeline(board)
            queue = _depth_of(dai, pipeline).createOutputQueue(maxSize=1, blocking=False)  # keeps the newest
            pipeline.start()
        except RuntimeError as error:
            raise not_started("oak", "device", serial, error, _connected(dai)) from error
        stack.callback(pipeline.stop)
        device = _Device(f"{board.getDeviceName()} {board.getDeviceId()}", board, pipeline, queue)
        stack.pop_all()
    return LiveRecording(device, given)


def _library() -> Any:
    try:
        import depthai
    except ImportError as error:
        raise NetlibError(f"depthai is missing: pip install 'depthai>=3' ({reason_of(error)})") from error
    if not hasattr(depthai.node, "Camera"):
        raise NetlibError(f"depthai {depthai.__version__} is too old: pip install 'depthai>=3'")
    return depthai


def _connected(dai: Any) -> list[str]:
    """The identifiers of all devices."""
    with contextlib.suppress(RuntimeError):
        return [str(info.getDeviceId()) for info in dai.Device.getAllAvailableDevices()]
    return []


def _depth_of(dai: Any, pipeline: Any) -> Any:
    """The output with the depth of the left and the right camera."""
    stereo = pipeline.create(dai.node.StereoDepth)
    stereo.setLeftRightCheck(True)
    stereo.setSubpixel(True)
    stereo.setExtendedDisparity(True)
    for socket, side in ((dai.CameraBoardSocket.CAM_B, stereo.left), (dai.CameraBoardSocket.CAM_C, stereo.right)):
        pipeline.create(dai.node.Camera).build(socket).requestOutput(SIZE, fps=RATE).link(side)
    return stereo.depth


class _Device:
    """A started pipeline. The first frame shows the camera; it is not returned. Raises DataError without one."""

    def __init__(self, name: str, board: Any, pipeline: Any, queue: Any) -> None:
        self.name, self._board, self._pipeline, self._queue = name, board, pipeline, queue
        first = first_of(self._depth)
        if first is None:
            raise DataError(f"{name}: no frame of depth; has it two cameras?")
        (fx, _, u0), (_, fy, v0), _ = np.asarray(first.getTransformation().getIntrinsicMatrix(), np.float64).tolist()
        camera = calibrated(name, fx, fy, u0, v0, first.getWidth(), first.getHeight())
        self.info = CameraInfo(camera, Lens(), UNIT_MM, RATE, name)  # the pair is rectified

    def _depth(self) -> Any:
        """The next frame; None if there is none within a second."""
        return self._queue.get(timedelta(seconds=WAIT_S))

    def read(self) -> DeviceFrame | None:
        try:
            frame = self._depth()
        except RuntimeError as error:  # the queue was closed
            raise TimeoutError(reason_of(error)) from error
        if frame is None:
            return None
        return DeviceFrame(frame.getTimestampDevice().total_seconds(), frame.getFrame(), int(frame.getSequenceNum()))

    def close(self) -> None:
        for stop in (self._pipeline.stop, self._board.close):
            with contextlib.suppress(RuntimeError):  # it has been stopped, or unplugged
                stop()
