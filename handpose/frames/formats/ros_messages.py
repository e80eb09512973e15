"""ROS messages of depth cameras: images, raw or as PNG, and the camera's parameters."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera
from handpose.frames.lens import Lens, lens_of
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from netlib.files import pictures

IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
IMAGES = (IMAGE, COMPRESSED)
NUMBERS = ("std_msgs/msg/Float32", "std_msgs/msg/String")  # types of RealSense's options
PACKED = "/compressedDepth"  # ending of the topics of CompressedImage with depth
ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
# Millimetres and metres: REP 118, "Depth Images". RealSense's files have mono16, and their unit elsewhere.
UNITS_MM = {"16UC1": 1.0, "32FC1": 1000.0}
HEADER = 12  # bytes before the PNG of a compressedDepth


def encoding_of(message: Any) -> str:
    """The encoding of an image."""
    return str(message.encoding) if hasattr(message, "encoding") else str(message.format).partition(";")[0].strip()


def values_of(message: Any, where: str) -> NDArray[Any]:
    """The stored values (height, width) of an Image or a CompressedImage. Raises DataError."""
    encoding = encoding_of(message)
    if encoding not in ENCODINGS:
        raise DataError(f"{where}: an image of {encoding!r}; expected depth, {', '.join(ENCODINGS)}")
    if not hasattr(message, "encoding"):
        return _unpacked(message, encoding, where)
    dtype = np.dtype((">" if message.is_bigendian else "<") + ENCODINGS[encoding])
    if message.width * message.height > pictures.MAX_PIXELS:
        raise DataError(f"{where}: {message.width} x {message.height} pixels; expected those of a depth camera")
    height, step, row = message.height, message.step, message.width * dtype.itemsize
    if not (row and height) or step < row or len(message.data) < step * height:
        raise DataError(f"{where}: {len(message.data)} bytes in rows of {step}, which are no {message.width} x "
                        f"{height} pixels of {encoding}")  # fmt: skip
    rows = message.data[: step * height].reshape(height, step)[:, :row]
    return np.ascontiguousarray(rows).view(dtype)


def _unpacked(message: Any, encoding: str, where: str) -> NDArray[Any]:
    """The values of a PNG; depths in metres and other compressions are not supported."""
    content = bytes(message.data)[HEADER:]
    if ENCODINGS[encoding] != "u2" or not content.startswith(pictures.PNG):
        raise DataError(f"{where}: compressed depth of the format {message.format!r}; expected 16UC1 as PNG")
    values = pictures.decode(content, cv2.IMREAD_UNCHANGED, where)
    if values.dtype != np.uint16:
        raise DataError(f"{where}: a PNG of {values.dtype}, expected 16 bits")
    return values


def nanoseconds_of(message: Any) -> int:
    """The time stamp of an image; 0 without one."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def given_by(info: Any, topic: str, where: str) -> CameraInfo:
    """Camera and lens of a CameraInfo for a topic; unknown if the camera is not calibrated. Raises DataError.

    Images whose topic contains "rect" are undistorted: the matrix P holds for them, K and D for all others.
    """
    k, d, p = (list(map(float, getattr(info, name, getattr(info, name.lower(), ())))) for name in "KDP")
    straight = "rect" in topic.rpartition("/")[2] and len(p) == 12 and p[0] > 0
    fx, fy, u0, v0 = (p[0], p[5], p[2], p[6]) if straight else (k[0], k[4], k[2], k[5])
    if not fx:
        return CameraInfo()
    if not (math.isfinite(fx + fy + u0 + v0) and min(fx, fy) > 0):
        raise DataError(f"{where}: focal lengths {fx:g}, {fy:g}, middle {u0:g}, {v0:g}; expected finite ones")
    lens = Lens() if straight else lens_of(info.distortion_model, d, where)
    return CameraInfo(Camera("ros", fx, fy, u0, v0, info.width, info.height), lens, origin=where)


def metres_of(message: Any, where: str) -> float:
    """The number in RealSense's option Depth Units, a Float32 or a String. Raises DataError."""
    text = str(message.data)
    try:
        metres = float(text)
    except ValueError:
        metres = math.nan
    if not 0 < metres < 1:
        raise DataError(f"{where}: depth units of {text!r} m; expected a number between 0 and 1")
    return float(f"{metres:.6g}")  # 0.001 as Float32 is not 0.001
