"""ROS bags as written by cameras' programs, with made-up depth."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

Depth = np.ndarray[Any, Any]
K = [60.5, 0, 31.25, 0, 61.5, 23.75, 0, 0, 1]
START_NS = 1_700_000_000_000_000_000
STEP_NS = 33_333_333
TOPIC = "/camera/depth/image_raw"
REALSENSE = "/device_0/sensor_0"


def stamp_of(i: int) -> int:
    """Return the time of frame i in nanoseconds."""
    return START_NS + i * STEP_NS


class Messages:
    """The messages of ROS 1 or 2."""

    def __init__(self, is_ros1: bool) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
        self.is_ros1 = is_ros1

    def encode(self, kind: str, **fields: Any) -> bytes:
        encode = self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr
        return bytes(encode(self.store.types[kind](**fields), kind))

    def header(self, ns: int) -> Any:
        types = self.store.types
        time = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        more = {"seq": 0} if self.is_ros1 else {}
        return types["std_msgs/msg/Header"](stamp=time, frame_id="camera", **more)

    def image(
        self, values: Depth, ns: int, encoding: str = "16UC1", padding: int = 0, big: bool = False
    ) -> bytes:
        """Return an image whose rows have this number of padding bytes, in either byte order."""
        swapped = values.astype(values.dtype.newbyteorder(">" if big else "<"))
        rows = swapped.view(np.uint8).reshape(len(values), -1)
        data = np.hstack([rows, np.full((len(rows), padding), 99, np.uint8)])
        height, width = values.shape
        return self.encode(
            "sensor_msgs/msg/Image",
            header=self.header(ns),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=int(big),
            step=data.shape[1],
            data=data.ravel(),
        )

    def packed(self, values: Depth, ns: int) -> bytes:
        """Return an image in the format of the plug-in compressedDepth: twelve
        bytes, then a PNG.
        """
        content = bytes(12) + cv2.imencode(".png", values)[1].tobytes()
        return self.compressed(content, ns, "16UC1; compressedDepth png")

    def compressed(self, content: bytes, ns: int, form: str) -> bytes:
        """Return a CompressedImage."""
        header, data = self.header(ns), np.frombuffer(content, np.uint8)
        return self.encode("sensor_msgs/msg/CompressedImage", header=header, format=form, data=data)

    def info(
        self,
        shape: tuple[int, int],
        model: str = "plumb_bob",
        d: tuple[float, ...] = (0,) * 5,
        **more: Any,
    ) -> bytes:
        """Return a CameraInfo with K, D and P; ``k`` and ``p`` replace the usual ones."""
        name = str.upper if self.is_ros1 else str.lower
        k = more.get("k", K)
        p = more.get("p", np.insert(np.array(k, float), (3, 6, 9), 0))  # a column of zeros
        arrays = {"d": d, "k": k, "r": np.eye(3).ravel(), "p": p}
        roi = self.store.types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        height, width = shape
        return self.encode(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(START_NS),
            height=height,
            width=width,
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=roi,
            **{name(key): np.array(value, np.float64) for key, value in arrays.items()},
        )

    def number(self, value: float) -> bytes:
        return self.encode("std_msgs/msg/Float32", data=value)

    def text(self, value: str) -> bytes:
        return self.encode("std_msgs/msg/String", data=value)


Content = list[tuple[str, str, int, bytes]]  # topic, type, nanoseconds of the bag, message


def write(writer: Any, messages: Messages, content: Content) -> None:
    """Write all messages to a bag, in this order."""
    connections: dict[tuple[str, str], Any] = {}
    with writer:
        for topic, kind, ns, message in content:
            if (topic, kind) not in connections:
                connections[topic, kind] = writer.add_connection(
                    topic, kind, typestore=messages.store
                )
            writer.write(connections[topic, kind], ns, message)


def driver(
    messages: Messages,
    depth: Depth,
    topic: str = TOPIC,
    sensor: tuple[int, int] | None = None,
    **info: Any,
) -> Content:
    """Return the messages of a camera's ROS driver: 16UC1 images in mm, and the camera beside them.

    ``sensor`` is the height and width of its sensor, if the images have another.
    """
    of_camera = f"{topic.rpartition('/')[0]}/camera_info"
    camera = messages.info(sensor or depth.shape[1:], **info)
    content = [(of_camera, "sensor_msgs/msg/CameraInfo", START_NS, camera)]
    for i, image in enumerate(depth):
        ns = stamp_of(i)
        message = messages.image(image, ns)
        content.append((topic, "sensor_msgs/msg/Image", ns + 5_000_000, message))
    return content


def write_ros1(
    path: Path, depth: Depth, compression: str = "", make: Callable[..., Content] = driver
) -> Path:
    """Write a .bag."""
    from rosbags.rosbag1 import Writer

    writer = Writer(path)
    if compression:
        writer.set_compression(Writer.CompressionFormat[compression])
    messages = Messages(True)
    write(writer, messages, make(messages, depth))
    return path


def write_ros2(
    path: Path, depth: Depth, storage: str = "SQLITE3", make: Callable[..., Content] = driver
) -> Path:
    """Write a folder with a .db3 or an .mcap."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    messages = Messages(False)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage])
    write(writer, messages, make(messages, depth))
    return path


def realsense(
    messages: Messages, depth: Depth, tail: bool = True, option: str = "Depth_Units", **info: Any
) -> Content:
    """Return messages as from RealSense's SDK: mono16, the unit in an option, images four bytes
    longer than in ROS.
    """
    topic = f"{REALSENSE}/Depth_0"
    more = struct.pack("<f", 0.0001) if tail else b""
    unit = messages.number(0.0001)
    camera = messages.info(depth.shape[1:], **{"model": "Brown Conrady", **info})
    content = [
        (f"{REALSENSE}/option/{option}/value", "std_msgs/msg/Float32", 1, unit),
        (f"{topic}/info/camera_info", "sensor_msgs/msg/CameraInfo", 1, camera),
    ]
    for i, image in enumerate(depth):
        message = messages.image(image, 10**9 + i * STEP_NS, "mono16") + more
        content.append(
            (f"{topic}/image/data", "sensor_msgs/msg/Image", 1000 + i * STEP_NS, message)
        )
    return content


def write_realsense(path: Path, depth: Depth, **more: Any) -> Path:
    """Write a .bag as RealSense's SDK did until about version 2.57."""
    return write_ros1(
        path, depth, "LZ4", lambda messages, images: realsense(messages, images, **more)
    )


def realsense_db3(messages: Messages, depth: Depth) -> Content:
    """Return the messages of newer versions of the SDK: PNG, and the unit as text."""
    topic = f"{REALSENSE}/Depth_0/image"
    unit, camera = messages.text("0.000100"), messages.info(depth.shape[1:])
    content = [
        (f"{REALSENSE}/option/Depth_Units/value", "std_msgs/msg/String", 0, unit),
        (f"{topic}/camera_info", "sensor_msgs/msg/CameraInfo", 0, camera),
    ]
    of_depth, kind = f"{topic}/data/compressedDepth", "sensor_msgs/msg/CompressedImage"
    for i, image in enumerate(depth):
        ns = i * STEP_NS
        content.append((of_depth, kind, ns, messages.packed(image, ns)))
    return content
