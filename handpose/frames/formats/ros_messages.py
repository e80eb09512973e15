"""ROS messages of depth cameras: images, raw or compressed, and the camera's parameters.

A CompressedImage on a topic IMAGE/compressed has the bytes of a PNG or TIFF of 16 bits. On IMAGE/compressedDepth, 12
bytes precede a PNG: an unused number, then A and B, both float32. For 32FC1 a stored value v > 0 is A / (v - B) metres
(compressed_depth_image_transport, codec.cpp).
"""

from __future__ import annotations

import math
import struct
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
PACKED = ("/compressedDepth", "/compressed")  # endings of the topics of CompressedImage, those for depth first
ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
# Millimetres and metres: REP 118, "Depth Images". RealSense's files have mono16, and their unit elsewhere.
UNITS_MM = {"16UC1": 1.0, "32FC1": 1000.0}
HEADER = struct.Struct("<iff")  # of a compressedDepth
PICTURES = (pictures.PNG, b"II*\0", b"MM\0*")  # beginnings of a PNG and of TIFFs
GREY_16 = b"\x10\x00"  # bits and type of colours in the header of a PNG


def image_topic(topic: str) -> str:
    """The topic of the image that a topic has compressed, or the topic itself."""
    return next((topic.removesuffix(ending) for ending in PACKED if topic.endswith(ending)), topic)


def encoding_of(message: Any) -> str:
    """The encoding of an image. Some programs only write "png" as the format; its header shows whether it is depth."""
    if hasattr(message, "encoding"):
        return str(message.encoding)
    encoding = str(message.format).partition(";")[0].strip()
    if encoding.lower() in ("png", "") and _begins_with_grey(bytes(message.data[:26])):
        return "16UC1"
    return encoding


def _begins_with_grey(content: bytes) -> bool:
    """True for the beginning of a PNG of 16-bit grey values."""
    return content.startswith(pictures.PNG) and content[24:26] == GREY_16


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
                        f"{height} pixels of {encoding}")
    rows = np.asarray(message.data)[: step * height].reshape(height, step)[:, :row]
    return np.ascontiguousarray(rows).view(dtype)


def _unpacked(message: Any, encoding: str, where: str) -> NDArray[Any]:
    """The values of a compressed image. Raises DataError for compressions that do not preserve depth, and others."""
    content = bytes(message.data)
    has_header = not content.startswith(PICTURES)
    picture = content[HEADER.size :] if has_header else content
    if not picture.startswith(PICTURES):
        raise DataError(f"{where}: compressed depth of the format {message.format!r}; expected a PNG or TIFF of 16 "
                        "bits (of RVL, `ros2 run image_transport republish` makes raw images)")
    values = pictures.decode(picture, cv2.IMREAD_UNCHANGED, where)
    if encoding == "32FC1" and values.dtype == np.float32 and values.ndim == 2:
        return values
    if values.dtype != np.uint16 or values.ndim != 2:
        raise DataError(f"{where}: a picture of {values.dtype} {values.shape}, expected 16-bit grey values")
    if encoding != "32FC1":
        return values
    if not has_header:
        raise DataError(f"{where}: 32FC1 as 16-bit values without their scale; expected the format of compressedDepth")
    _, a, b = HEADER.unpack_from(content)
    if not (math.isfinite(a + b) and a > 0):
        raise DataError(f"{where}: compressed depth with the parameters {a:g} and {b:g}; expected a positive and a "
                        "finite number")
    with np.errstate(all="ignore"):  # a value next to B is infinitely far away, which counts as no reading
        metres = np.float32(a) / (values.astype(np.float32) - np.float32(b))
    return np.where(values > 0, metres, np.float32(0))


def nanoseconds_of(message: Any) -> int:
    """The time stamp of an image; 0 without one."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def given_by(info: Any, topic: str, shape: tuple[int, ...], where: str) -> CameraInfo:
    """Camera and lens of a CameraInfo for a topic; unknown if the camera is not calibrated. Raises DataError.

    Images whose topic contains "rect" are undistorted: the matrix P holds for them, K and D for all others. Both are
    those of the complete sensor. The images may show a region of it, with binned pixels; ``shape`` is their height and
    width.
    """
    k, d, p = (list(map(float, getattr(info, name, getattr(info, name.lower(), ())))) for name in "KDP")
    straight = "rect" in topic.rpartition("/")[2] and len(p) == 12 and p[0] > 0
    fx, fy, u0, v0 = (p[0], p[5], p[2], p[6]) if straight else (k[0], k[4], k[2], k[5])
    if not fx:
        return CameraInfo()
    if not (math.isfinite(fx + fy + u0 + v0) and min(fx, fy) > 0):
        raise DataError(f"{where}: focal lengths {fx:g}, {fy:g}, middle {u0:g}, {v0:g}; expected finite ones")
    lens = Lens() if straight else lens_of(info.distortion_model, d, where)
    full = (info.height, info.width)
    if shape == full or not any(full):  # whatever the region and the binning are, these are all pixels
        return CameraInfo(Camera("ros", fx, fy, u0, v0, *shape[::-1]), lens, origin=where)
    roi, (bin_x, bin_y) = info.roi, (max(1, int(info.binning_x)), max(1, int(info.binning_y)))
    left, top = int(roi.x_offset), int(roi.y_offset)
    height, width = int(roi.height) or full[0] - top, int(roi.width) or full[1] - left
    if shape != (height // bin_y, width // bin_x):
        raise DataError(
            f"{where}: the camera has {full[1]} x {full[0]} pixels, of which a region of {width} x {height} at {left}, "
            f"{top} is read with a binning of {bin_x} x {bin_y}; expected images of that size, found {shape[1]} x "
            f"{shape[0]}; --camera with the parameters of these images replaces it"
        )
    # As image_geometry computes them: pixel coordinates are divided, without a shift of half a pixel.
    camera = Camera("ros", fx / bin_x, fy / bin_y, (u0 - left) / bin_x, (v0 - top) / bin_y, *shape[::-1])
    return CameraInfo(camera, lens, origin=where)


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
