"""ROS bags with depth: RealSense's .bag and .db3, and those of any camera's driver, of ROS 1 and 2.

PATH is a .bag, a .db3, an .mcap or a folder of ROS 2; PATH#TOPIC selects the images if several topics have depth.

Messages are read as the ROS types of their topics. A bag also contains definitions, from which the library
would generate code: they are ignored.
"""

from __future__ import annotations

import contextlib
import functools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.formats import ros_limits
from handpose.frames.formats import ros_messages as messages
from handpose.frames.formats.contained import Contained
from handpose.frames.raw import Calibration, calibration_of
from handpose.frames.recording import CameraInfo, Recording
from netlib.errors import DataError, NetlibError, did_you_mean, reason_of, system_error_of
from netlib.files.paths import exists

OPTIONS = ("Depth_Units", "Depth Units")  # RealSense's names for one option, new and old
REINDEX = "; a recorder that was killed leaves such a bag, and `rosbag reindex` repairs it"


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
        """The time of recording in nanoseconds of each message of a topic, and the message.

        ``kinds`` are the allowed types: a bag may have several connections for one topic, with different types. Raises
        DataError for messages of more than one of them, and rosbags' errors.
        """
        connections = [one for one in self.reader.connections if one.topic == topic and one.msgtype in kinds]
        there = sorted({one.msgtype for one in connections if one.msgcount})
        if len(there) > 1:
            raise DataError(f"{self.where}: {topic}: messages of {len(there)} types, {', '.join(there)}; expected one")
        ids = {one.id for one in connections}
        with ros_limits.named_limits():
            for connection, time, content in self.reader.messages(connections=connections) if connections else ():
                if connection.id not in ids:
                    raise ValueError(f"the index leads to a message of {connection.topic}, {connection.msgtype}")
                ros_limits.check_message(content)
                yield time, self._message(content, connection.msgtype)

    def _message(self, content: bytes, kind: str) -> Any:
        store = _types(self.is_ros1)
        if not self.is_ros1:
            return store.deserialize_cdr(content, kind)
        try:
            return store.deserialize_ros1(content, kind)
        except Exception:
            if kind != messages.IMAGE:
                raise
            return store.deserialize_ros1(content[:-4], kind)  # RealSense appends the depth units, which ROS lacks

    def first(self, topic: str, *kinds: str) -> Any:
        """The first message of a topic, of one of some types. Raises DataError."""
        try:
            return next(self.messages(topic, *kinds))[1]
        except NetlibError:
            raise
        except Exception as error:  # for a damaged bag the library may raise any exception
            raise DataError(f"{self.where}: {topic}: no message can be read: {reason_of(error)}") from error


@functools.cache
def _types(is_ros1: bool) -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Bag]:
    """A bag. Raises DataError, and NetlibError without rosbags; within the block it raises what rosbags raises."""
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise NetlibError(f"rosbags is missing: pip install rosbags ({reason_of(error)})") from error
    ros_limits.check_files(path)
    ros_limits.limit_reading()
    is_ros1 = path.suffix.lower() == ".bag" and not path.is_dir()
    try:
        reader = (rosbag1 if is_ros1 else rosbag2).Reader(path)
        with ros_limits.limited_rows(), ros_limits.named_limits():
            reader.open()
    except Exception as error:  # for a damaged bag the library may raise any exception
        if system := system_error_of(error):
            raise DataError(f"{path}: cannot read the bag: {reason_of(system)}") from error
        raise DataError(f"{path}: cannot read the bag: damaged or cut: {reason_of(error)}"
                        f"{REINDEX if is_ros1 and 'index' in str(error) else ''}") from error
    with contextlib.closing(reader):
        yield Bag(reader, is_ros1, str(path))


def open_bag(path: Path, given: CameraInfo) -> Recording:
    """The depth of a bag. Raises DataError, and NetlibError without rosbags."""
    name, _, asked = str(path).partition("#")
    if asked and not exists(path):
        path = Path(name)
    with _opened(path) as bag:
        topic = _depth_topic(bag, asked)
        where = f"{path}: {topic}"
        image = bag.first(topic, *messages.IMAGES)
        values = messages.values_of(image, where)
        own = _own(bag, topic, messages.encoding_of(image), values.shape, given.camera is not None)
        calibration = calibration_of(given, own, camera_file.next_to(path), values.shape, values.dtype, where)
        return _BagRecording(path, calibration, topic, bag.topics(*messages.IMAGES)[topic])


class _BagRecording(Contained):
    """The images of one topic."""

    def __init__(self, path: Path, calibration: Calibration, topic: str, count: int) -> None:
        super().__init__(path, calibration, count)
        self._topic = topic

    def _stored(self) -> Iterator[tuple[float, NDArray[Any]]]:
        with _opened(self._path) as bag:
            first = None
            for received, image in bag.messages(self._topic, *messages.IMAGES):
                taken = messages.nanoseconds_of(image)
                if first is None:
                    stamped = taken > 0
                    first = taken if stamped else received
                seconds = ((taken if stamped else received) - first) / 1e9
                yield seconds, messages.values_of(image, f"{self.name}: {self._topic}")


def _depth_topic(bag: Bag, asked: str) -> str:
    """The requested topic, or the only one with depth. Raises DataError."""
    images = {topic: topic for topic in bag.topics(messages.IMAGE)}
    packed = bag.topics(messages.COMPRESSED)
    for ending in (*messages.PACKED, ""):  # compressed copies of an image do not count
        images = {messages.image_topic(topic): topic for topic in packed if topic.endswith(ending)} | images
    if asked:
        if asked not in (all_images := [*bag.topics(*messages.IMAGES)]):
            raise DataError(f"{bag.where}: no images of {asked!r}{did_you_mean(asked, all_images)}; it has "
                            f"{', '.join(all_images) or 'none'}")
        return asked
    encodings = {t: messages.encoding_of(bag.first(t, *messages.IMAGES)) for t in images.values()}
    depth = [topic for topic, encoding in encodings.items() if encoding in messages.ENCODINGS]
    named = [topic for topic in depth if "depth" in topic.lower()] or depth  # infrared has 16 bits, too
    if not named:
        found = ", ".join(f"{topic} of the encoding {encoding!r}" for topic, encoding in encodings.items())
        raise DataError(f"{bag.where}: no images of depth, which have the encoding {', '.join(messages.ENCODINGS)}; it "
                        f"has {found or 'no images'}")
    if len(named) > 1:
        raise DataError(f"{bag.where}: depth of {len(named)} topics: {', '.join(sorted(named))}; name one by "
                        f"{bag.where}#TOPIC")
    return named[0]


def _own(bag: Bag, topic: str, encoding: str, shape: tuple[int, ...], has_camera: bool) -> CameraInfo:
    """The bag's parameters of the camera of a topic, and the unit; if the user gave a camera, invalid ones count as
    unknown.
    """
    base = messages.image_topic(topic)
    parent = base.rpartition("/")[0]
    places = (f"{parent}/camera_info", f"{parent.rpartition('/')[0]}/info/camera_info")  # ROS's and RealSense's
    infos = bag.topics(messages.INFO)
    said = CameraInfo()
    if found := next((place for place in places if place in infos), None):
        with contextlib.suppress(*([DataError] if has_camera else [])):
            said = messages.given_by(bag.first(found, messages.INFO), base, shape, f"{bag.where}: {found}")
    return CameraInfo(said.camera, said.lens, _unit_mm(bag, base, encoding), None, bag.where)


def _unit_mm(bag: Bag, topic: str, encoding: str) -> float | None:
    sensor = re.match(r"/device_\d+/sensor_\d+(?=/)", topic)
    options = [f"{sensor[0]}/option/{name}/value" for name in OPTIONS] if sensor else []
    there = bag.topics(*messages.NUMBERS)
    found = next((option for option in options if option in there), None)
    if found is None:
        return messages.UNITS_MM.get(encoding)
    return 1000 * messages.metres_of(bag.first(found, *messages.NUMBERS), f"{bag.where}: {found}")
