"""A topic of ROS 2 with depth images, through rclpy.

with open_live("/camera/depth/image_rect_raw", CameraInfo()) as recording:
    for frame in recording: ...

The camera is that of the topic camera_info next to it. Messages are read as those of bags. rclpy is a part of ROS 2 and
not on the package index. Tested with simulated messages only.
"""

from __future__ import annotations

import contextlib
import time
from typing import Any, NamedTuple

from handpose.frames.formats import ros_messages as messages
from handpose.frames.live import WAIT_S, WAITS, DeviceFrame, LiveRecording
from handpose.frames.raw import sized
from handpose.frames.recording import CameraInfo, Recording
from netlib.errors import DataError, NetlibError, reason_of

MISSING = ("rclpy is missing: it is a part of ROS 2 (apt install ros-DISTRO-ros-base, then "
           "source /opt/ros/DISTRO/setup.bash), and needs the Python of that distribution")


def open_live(topic: str | None, given: CameraInfo) -> Recording:
    """The images of a topic. Raises DataError if none come, and NetlibError without rclpy."""
    if not topic:
        raise DataError("ros2: expected a topic, as in ros2:/camera/depth/image_rect_raw")
    node = _Node(_library(), topic)
    with contextlib.ExitStack() as stack:
        stack.callback(node.close)
        device = _Device(node, given)
        stack.pop_all()
    return LiveRecording(device, given)


class _Library(NamedTuple):
    """rclpy, its qualities of service and signals, and the types of messages."""

    rclpy: Any
    qos: Any
    signals: Any
    msg: Any


def _library() -> _Library:
    try:
        import rclpy
        import rclpy.qos
        import rclpy.signals
        import sensor_msgs.msg
    except ImportError as error:
        raise NetlibError(f"{MISSING} ({reason_of(error)})") from error
    return _Library(rclpy, rclpy.qos, rclpy.signals, sensor_msgs.msg)


class _Node:
    """A node that keeps the newest image of a topic and its camera_info.

    Signals are left to the program, so that Ctrl-C ends a recording properly.
    """

    def __init__(self, library: _Library, topic: str) -> None:
        self.topic, self._rclpy = topic, library.rclpy
        self.image: Any = None
        self.info: Any = None
        self._owns_context = not self._rclpy.ok()
        if self._owns_context:
            self._rclpy.init(signal_handler_options=library.signals.SignalHandlerOptions.NO)
        self._node = self._rclpy.create_node("handpose")
        newest = library.qos.QoSProfile(depth=1, reliability=library.qos.ReliabilityPolicy.BEST_EFFORT)
        base = messages.image_topic(topic)
        kind = library.msg.Image if base == topic else library.msg.CompressedImage
        self.info_topic = f"{base.rpartition('/')[0]}/camera_info"
        self._node.create_subscription(kind, topic, self._keep_image, newest)
        self._node.create_subscription(library.msg.CameraInfo, self.info_topic, self._keep_info, newest)

    def _keep_image(self, message: Any) -> None:
        self.image = message

    def _keep_info(self, message: Any) -> None:
        self.info = message

    def spin(self) -> None:
        """Receive one message, if one comes within a second."""
        self._rclpy.spin_once(self._node, timeout_sec=WAIT_S)

    def close(self) -> None:
        """Destroy the node; a second call has no effect."""
        node, self._node = self._node, None
        if node is not None:
            node.destroy_node()
            if self._owns_context:
                self._rclpy.try_shutdown()


class _Device:
    """The images of a node. The first one shows the size and the unit; it is not returned."""

    def __init__(self, node: _Node, given: CameraInfo) -> None:
        self.name = f"ros2:{node.topic}"
        self._node = node
        deadline = time.monotonic() + WAITS * WAIT_S
        while node.image is None or (node.info is None and given.camera is None):
            node.spin()
            if time.monotonic() > deadline:
                missing = node.topic if node.image is None else node.info_topic
                raise DataError(f"{self.name}: no message on {missing} for {WAITS * WAIT_S:g} s"
                                f"{'' if node.image is None else '; give --camera'}")
        first, node.image = node.image, None
        values = messages.values_of(first, self.name)
        said = CameraInfo()
        if node.info is not None:
            with contextlib.suppress(*([] if given.camera is None else [DataError])):
                base = messages.image_topic(node.topic)
                said = messages.given_by(node.info, base, values.shape, f"{self.name}: {node.info_topic}")
        camera = said.camera or (given.camera and sized(given.camera, values.shape, self.name))
        if camera is None:
            raise DataError(f"{self.name}: {node.info_topic} has a camera that is not calibrated; give --camera")
        unit_mm = messages.UNITS_MM.get(messages.encoding_of(first), 1.0)
        self.info = CameraInfo(camera, said.lens, unit_mm, origin=self.name)

    def read(self) -> DeviceFrame | None:
        if self._node.image is None:
            self._node.spin()
        image, self._node.image = self._node.image, None
        if image is None:
            return None
        stamp = messages.nanoseconds_of(image)
        seconds = stamp / 1e9 if stamp else time.monotonic()
        return DeviceFrame(seconds, messages.values_of(image, self.name), clock="stamps" if stamp else "arrival")

    def close(self) -> None:
        self._node.close()
