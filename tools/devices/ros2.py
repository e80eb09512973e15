"""A depth topic of ROS 2 (written for Humble): source /opt/ros/humble/setup.bash."""

from __future__ import annotations

from typing import Any

import numpy as np
import rclpy
from sensor_msgs.msg import CameraInfo as Info
from sensor_msgs.msg import Image

from handpose import Camera, CameraInfo, DeviceFrame

WAIT_S = 1.0


class Topic:
    """A topic with images in 16UC1, and the camera_info next to it."""

    def __init__(self, topic: str) -> None:
        rclpy.init()
        self._node = rclpy.create_node("handpose")
        self._images: list[Any] = []
        infos: list[Any] = []
        self._node.create_subscription(Image, topic, self._images.append, 1)
        self._node.create_subscription(
            Info, f"{topic.rpartition('/')[0]}/camera_info", infos.append, 1
        )
        while not infos:
            rclpy.spin_once(self._node, timeout_sec=WAIT_S)
        k = infos[0].k
        camera = Camera("ros", k[0], k[4], k[2], k[5], infos[0].width, infos[0].height)
        self.name = topic
        self.info = CameraInfo(camera, unit_mm=1.0)

    def read(self) -> DeviceFrame | None:
        """The next frame; None if none comes."""
        self._images.clear()
        rclpy.spin_once(self._node, timeout_sec=WAIT_S)
        if not self._images:
            return None
        image = self._images[-1]
        rows = np.frombuffer(image.data, np.uint16).reshape(image.height, image.step // 2)
        seconds = image.header.stamp.sec + image.header.stamp.nanosec / 1e9
        return DeviceFrame(seconds, rows[:, : image.width])

    def close(self) -> None:
        """Leave ROS."""
        self._node.destroy_node()
        rclpy.shutdown()
