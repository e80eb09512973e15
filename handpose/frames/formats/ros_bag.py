"""ROS bags with depth: RealSense's .bag and .db3, and those of any camera's driver, of ROS 1 and 2.

PATH is a .bag, a .db3, an .mcap or a folder of ROS 2; PATH#TOPIC selects the images if several
topics have depth.

Messages are read as the ROS types of their topics. A bag also contains definitions of types,
from which rosbags' AnyReader generates code and runs it; the readers of ROS 1 and 2 that are
used here ignore them.

A CompressedImage on a topic IMAGE/compressed has the bytes of a PNG or TIFF of 16 bits. On
IMAGE/compressedDepth, 12 bytes precede a PNG (compressed_depth_image_transport, codec.cpp).
"""

from __future__ import annotations

import contextlib
import functools
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.camera_places import next_to
from handpose.frames.cameras import Camera
from handpose.frames.images import errors_of
from handpose.frames.lens import Lens, lens_of
from handpose.frames.recording import CameraInfo, DepthDecoder, DepthFrame, Recording
from netlib.errors import DataError, NetlibError, did_you_mean, reason_of, system_error_of
from netlib.files import pictures
from netlib.files.paths import exists

OPTIONS = ("Depth_Units", "Depth Units")  # RealSense's names for one option, new and old
REINDEX = " (`rosbag reindex` repairs a bag whose recorder was killed)"


class Bag(NamedTuple):
    """An open bag.

    reader  of rosbags
    is_ros1 False for ROS 2
    where   name for messages
    """

    reader: Any
    is_ros1: bool
    where: str

    def topics(self, *kinds: str) -> dict[str, int]:
        """The number of messages of each topic of some types."""
        found: dict[str, int] = {}
        for connection in self.reader.connections:
            if connection.msgtype in kinds and connection.msgcount:
                found[connection.topic] = found.get(connection.topic, 0) + connection.msgcount
        return found

    def messages(self, topic: str, *kinds: str) -> Iterator[tuple[int, Any]]:
        """The time of recording in nanoseconds of each message of a topic, of some types,
        and the message.

        Raises rosbags' errors.
        """
        connections = [
            one for one in self.reader.connections if one.topic == topic and one.msgtype in kinds
        ]
        for connection, time, content in (
            self.reader.messages(connections=connections) if connections else ()
        ):
            yield time, self._message(content, connection.msgtype)

    def _message(self, content: bytes, kind: str) -> Any:
        store = _types(self.is_ros1)
        if not self.is_ros1:
            return store.deserialize_cdr(content, kind)
        try:
            return store.deserialize_ros1(content, kind)
        except Exception:
            if kind != IMAGE:
                raise
            # RealSense appends the depth units, which ROS lacks
            return store.deserialize_ros1(content[:-4], kind)

    def first(self, topic: str, *kinds: str) -> Any:
        """The first message of a topic, of one of some types. Raises DataError."""
        with errors_of(f"{self.where}: {topic}", "the messages", "no message can be read"):
            _, message = next(self.messages(topic, *kinds))
        return message


@functools.cache
def _types(is_ros1: bool) -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Bag]:
    """A bag.

    Raises DataError, and NetlibError without rosbags; within the block it raises what
    rosbags raises.
    """
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise NetlibError(
            f"rosbags is missing: pip install rosbags ({reason_of(error)})"
        ) from error
    is_ros1 = path.suffix.lower() == ".bag" and not path.is_dir()
    damaged = f"cannot read the bag: damaged or cut{REINDEX if is_ros1 else ''}"
    with errors_of(str(path), "the bag", damaged):
        reader = (rosbag1 if is_ros1 else rosbag2).Reader(path)
        reader.open()
    with contextlib.closing(reader):
        yield Bag(reader, is_ros1, str(path))


class BagRecording(Recording):
    """The images of one topic, until the end of the bag or of its intact part.

    Every iteration opens it again.

    Raises DataError, and NetlibError without rosbags.
    """

    def __init__(self, path: Path, given: CameraInfo) -> None:
        name, _, asked = str(path).partition("#")
        self._path = Path(name) if asked and not exists(path) else path
        with _opened(self._path) as bag:
            self._topic = _depth_topic(bag, asked)
            where = f"{self._path}: {self._topic}"
            image = bag.first(self._topic, *IMAGES)
            values = values_of(image, where)
            own = _own(bag, self._topic, encoding_of(image), values.shape, given.camera is not None)
            camera_json = next_to(self._path, given.camera is None and own.camera is None)
            self._decode_by(
                DepthDecoder(values.shape, values.dtype, where, given, own, camera_json)
            )
            self.name = str(self._path)
            self.count = bag.topics(*IMAGES)[self._topic]

    def __iter__(self) -> Iterator[DepthFrame]:
        self.cut = ""
        self.remarks = self._decode.remarks
        number, last, late = -1, -math.inf, 0
        try:
            for number, (time, raw) in enumerate(self._stored()):
                if time <= last:
                    late += 1
                    continue
                last = time
                yield DepthFrame(number, time, self._decode(raw, f"{self.name}: frame {number}"))
        except NetlibError:
            raise
        except Exception as error:  # for a damaged bag the library may raise any exception
            if system := system_error_of(error):
                raise DataError(
                    f"{self.name}: cannot read the frames: {reason_of(system)}"
                ) from error
            if number < 0:
                raise DataError(
                    f"{self.name}: not one frame can be read: {reason_of(error)}"
                ) from error
            self.cut = f"damaged or cut after frame {number}: {reason_of(error)}"
        if late:
            self.remarks += (
                f"frames left out because they are not later than the one before: {late}",
            )

    def _stored(self) -> Iterator[tuple[float, NDArray[Any]]]:
        """Seconds by the images' clock, or if they have none by the bag's, and stored values."""
        with _opened(self._path) as bag:
            first = None
            for received, image in bag.messages(self._topic, *IMAGES):
                stamp = image.header.stamp
                taken = int(stamp.sec) * 10**9 + int(stamp.nanosec)  # 0 without a time
                if first is None:
                    stamped = taken > 0
                    first = taken if stamped else received
                seconds = ((taken if stamped else received) - first) / 1e9
                yield seconds, values_of(image, f"{self.name}: {self._topic}")


def _depth_topic(bag: Bag, asked: str) -> str:
    """The requested topic, or the only one with depth. Raises DataError."""
    images = {topic: topic for topic in bag.topics(IMAGE)}
    packed = bag.topics(COMPRESSED)
    for ending in (*PACKED, ""):  # compressed copies of an image do not count
        images = {image_topic(topic): topic for topic in packed if topic.endswith(ending)} | images
    if asked:
        if asked not in (all_images := [*bag.topics(*IMAGES)]):
            raise DataError(
                f"{bag.where}: no images of {asked!r}{did_you_mean(asked, all_images)}; it has "
                f"{', '.join(all_images) or 'none'}"
            )
        return asked
    encodings = {t: encoding_of(bag.first(t, *IMAGES)) for t in images.values()}
    depth = [topic for topic, encoding in encodings.items() if encoding in ENCODINGS]
    # infrared has 16 bits, too
    named = [topic for topic in depth if "depth" in topic.lower()] or depth
    if not named:
        found = ", ".join(
            f"{topic} of the encoding {encoding!r}" for topic, encoding in encodings.items()
        )
        raise DataError(
            f"{bag.where}: no images of depth, which have the encoding {', '.join(ENCODINGS)}; it "
            f"has {found or 'no images'}"
        )
    if len(named) > 1:
        raise DataError(
            f"{bag.where}: depth of {len(named)} topics: {', '.join(sorted(named))}; name one by "
            f"{bag.where}#TOPIC"
        )
    return named[0]


def _own(
    bag: Bag, topic: str, encoding: str, shape: tuple[int, ...], has_camera: bool
) -> CameraInfo:
    """The bag's parameters of the camera of a topic, and the unit; if the user gave a camera,
    invalid ones count as unknown.
    """
    base = image_topic(topic)
    parent = base.rpartition("/")[0]
    # ROS's and RealSense's
    places = (f"{parent}/camera_info", f"{parent.rpartition('/')[0]}/info/camera_info")
    infos = bag.topics(INFO)
    said = CameraInfo()
    if found := next((place for place in places if place in infos), None):
        with contextlib.suppress(*([DataError] if has_camera else [])):
            said = given_by(bag.first(found, INFO), base, shape, f"{bag.where}: {found}")
    return CameraInfo(said.camera, said.lens, _unit_mm(bag, base, encoding), None, bag.where)


def _unit_mm(bag: Bag, topic: str, encoding: str) -> float | None:
    sensor = re.match(r"/device_\d+/sensor_\d+(?=/)", topic)
    options = [f"{sensor[0]}/option/{name}/value" for name in OPTIONS] if sensor else []
    there = bag.topics(*OPTION_TYPES)
    found = next((option for option in options if option in there), None)
    if found is None:
        return UNITS_MM.get(encoding)
    return 1000 * metres_of(bag.first(found, *OPTION_TYPES), f"{bag.where}: {found}")


# ----------------------------------------------------------------------------------------- messages

IMAGE, COMPRESSED, INFO = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo",
)
IMAGES = (IMAGE, COMPRESSED)
OPTION_TYPES = ("std_msgs/msg/Float32", "std_msgs/msg/String")  # types of RealSense's options
# endings of the topics of CompressedImage, those for depth first
PACKED = ("/compressedDepth", "/compressed")
ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
# Millimetres and metres: REP 118, "Depth Images". RealSense's files have mono16, and their
# unit elsewhere.
UNITS_MM = {"16UC1": 1.0, "32FC1": 1000.0}
HEADER_BYTES = 12  # of a compressedDepth
PICTURE_SIGNATURES = (pictures.PNG, b"II*\0", b"MM\0*")  # beginnings of a PNG and of TIFFs
GREY_16 = b"\x10\x00"  # bits and type of colours in the header of a PNG


def image_topic(topic: str) -> str:
    """The topic of the image that a topic has compressed, or the topic itself."""
    return next((topic.removesuffix(ending) for ending in PACKED if topic.endswith(ending)), topic)


def encoding_of(message: Any) -> str:
    """The encoding of an image.

    Some programs only write "png" as the format; its header shows whether it is depth.
    """
    if hasattr(message, "encoding"):
        return str(message.encoding)
    encoding = str(message.format).partition(";")[0].strip()
    start = bytes(message.data[:26])
    if encoding.lower() in ("png", "") and start.startswith(pictures.PNG) and start[24:] == GREY_16:
        return "16UC1"
    return encoding


def values_of(message: Any, where: str) -> NDArray[Any]:
    """The stored values (height, width) of an Image or a CompressedImage. Raises DataError."""
    encoding = encoding_of(message)
    if encoding not in ENCODINGS:
        raise DataError(
            f"{where}: an image of {encoding!r}; expected depth, {', '.join(ENCODINGS)}"
        )
    if not hasattr(message, "encoding"):
        return _unpacked(message, encoding, where)
    dtype = np.dtype((">" if message.is_bigendian else "<") + ENCODINGS[encoding])
    height, step, row = message.height, message.step, message.width * dtype.itemsize
    if not (row and height) or step < row or len(message.data) < step * height:
        raise DataError(
            f"{where}: {len(message.data)} bytes in rows of {step}, which are no {message.width} x "
            f"{height} pixels of {encoding}"
        )
    rows = np.asarray(message.data)[: step * height].reshape(height, step)[:, :row]
    return np.ascontiguousarray(rows).view(dtype)


def _unpacked(message: Any, encoding: str, where: str) -> NDArray[Any]:
    """The values of a compressed image.

    Raises DataError for compressions that do not preserve depth, and others.
    """
    content = bytes(message.data)
    picture = content if content.startswith(PICTURE_SIGNATURES) else content[HEADER_BYTES:]
    if encoding == "32FC1" or not picture.startswith(PICTURE_SIGNATURES):
        raise DataError(
            f"{where}: compressed depth of the format {message.format!r}; expected a PNG or TIFF of 16 "
            "bits (of others, `ros2 run image_transport republish` makes raw images)"
        )
    values = pictures.decode(picture, cv2.IMREAD_UNCHANGED, where)
    if values.dtype != np.uint16 or values.ndim != 2:
        raise DataError(
            f"{where}: a picture of {values.dtype} {values.shape}, expected 16-bit grey values"
        )
    return values


def given_by(info: Any, topic: str, shape: tuple[int, ...], where: str) -> CameraInfo:
    """Camera and lens of a CameraInfo for a topic; unknown if the camera is not calibrated.

    Raises DataError.

    Images whose topic contains "rect" are undistorted: the matrix P holds for them, K and D for all
    others. Images of another ``shape``, height and width, than the CameraInfo's show a region of
    the sensor, or binned pixels.
    """
    k, d, p = (
        list(map(float, getattr(info, name, getattr(info, name.lower(), ())))) for name in "KDP"
    )
    straight = "rect" in topic.rpartition("/")[2] and len(p) == 12 and p[0] > 0
    fx, fy, u0, v0 = (p[0], p[5], p[2], p[6]) if straight else (k[0], k[4], k[2], k[5])
    if not fx:
        return CameraInfo()
    if not (math.isfinite(fx + fy + u0 + v0) and min(fx, fy) > 0):
        raise DataError(
            f"{where}: focal lengths {fx:g}, {fy:g}, middle {u0:g}, {v0:g}; expected finite ones"
        )
    lens = Lens() if straight else lens_of(info.distortion_model, d, where)
    if any(full := (info.height, info.width)) and shape != full:
        raise DataError(
            f"{where}: the camera has {full[1]} x {full[0]} pixels, the images have {shape[1]} x "
            f"{shape[0]}; expected the same; of a region or binned pixels give the parameters by --camera"
        )
    return CameraInfo(Camera("ros", fx, fy, u0, v0, *shape[::-1]), lens, origin=where)


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
