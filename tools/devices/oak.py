"""The stereo depth of an OAK-D: pip install 'depthai>=3' (written for 3.12.0)."""

from __future__ import annotations

from datetime import timedelta

import depthai

from handpose import Camera, CameraInfo, DeviceFrame

SIZE = (640, 400)  # px
RATE = 30.0  # Hz
START_TIMEOUT = timedelta(seconds=5)
FRAME_TIMEOUT = timedelta(seconds=1)


class Oak:
    """Depth of the left and the right camera, with extended disparity."""

    def __init__(self) -> None:
        self._pipeline = depthai.Pipeline(depthai.Device())
        stereo = self._pipeline.create(depthai.node.StereoDepth)
        stereo.setLeftRightCheck(True)
        stereo.setSubpixel(True)
        stereo.setExtendedDisparity(True)
        sockets = depthai.CameraBoardSocket
        for socket, side in ((sockets.CAM_B, stereo.left), (sockets.CAM_C, stereo.right)):
            camera_node = self._pipeline.create(depthai.node.Camera).build(socket)
            camera_node.requestOutput(SIZE, fps=RATE).link(side)
        self._queue = stereo.depth.createOutputQueue(maxSize=1, blocking=False)
        self._pipeline.start()
        first = self._queue.get(START_TIMEOUT)
        (fx, _, u0), (_, fy, v0), _ = first.getTransformation().getIntrinsicMatrix()
        camera = Camera("oak", fx, fy, u0, v0, first.getWidth(), first.getHeight())
        self.name = "oak"
        self.info = CameraInfo(camera, unit_mm=1.0, rate=RATE)

    def read(self) -> DeviceFrame | None:
        """The next frame; None if none comes within FRAME_TIMEOUT."""
        frame = self._queue.get(FRAME_TIMEOUT)
        if frame is None:
            return None
        seconds = frame.getTimestampDevice().total_seconds()
        return DeviceFrame(seconds, frame.getFrame(), frame.getSequenceNum())

    def close(self) -> None:
        """Stop the stream."""
        self._pipeline.stop()
