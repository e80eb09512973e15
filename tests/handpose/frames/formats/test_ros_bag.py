"""ROS bags recorded by RealSense's own program and by drivers, for ROS 1 and 2."""

from __future__ import annotations

import functools
import struct
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats import open_recording, ros_bag
from handpose.frames.formats.ros_bag import BagRecording
from handpose.frames.lens import Lens
from handpose.frames.recording import UNKNOWN, CameraInfo, DepthFrame, Recording
from netlib.errors import DataError, NetlibError
from tests.handpose.frames.conftest import times_of
from tests.support import bags
from tests.support.bad_input import bad_inputs

pytest.importorskip("rosbags", reason="rosbags is missing: pip install rosbags")

DEPTH = np.random.default_rng(0).integers(0, 4000, (4, 48, 64)).astype(np.uint16)
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
GIVEN = CameraInfo(camera=Camera("own", 60, 60, 32, 24, 0, 0), origin="--camera")
KINDS: dict[str, Any] = {
    "realsense.bag": bags.write_realsense,
    "older_realsense.bag": functools.partial(
        bags.write_realsense, tail=False, option="Depth Units"
    ),
    "plain.bag": bags.write_ros1,
    "bz2.bag": functools.partial(bags.write_ros1, compression="BZ2"),
    "sqlite": bags.write_ros2,
    "mcap": functools.partial(bags.write_ros2, storage="MCAP"),
    "realsense_db3": functools.partial(bags.write_ros2, make=bags.realsense_db3),
    # files without their folder
    "a.db3": lambda path, depth: bags.write_ros2(path.with_suffix(""), depth) / "a.db3",
    "a.mcap": lambda path, depth: (
        bags.write_ros2(path.with_suffix(""), depth, storage="MCAP") / "a.mcap"
    ),
}


def png(values: np.ndarray, ending: str = ".png") -> bytes:
    """The bytes of an image file."""
    return cv2.imencode(ending, values)[1].tobytes()


def images(*messages: tuple[bytes, int], topic: str = bags.TOPIC, **info: Any) -> Any:
    """A function that makes a bag with these images and the camera of ``info``."""

    def make(of: bags.Messages, depth: bags.Depth) -> bags.Content:
        return bags.driver(of, depth[:0], topic, **info) + [
            (topic, IMAGE, ns, content) for content, ns in messages
        ]

    return make


def read(path: Path, given: CameraInfo = UNKNOWN) -> tuple[Recording, list[DepthFrame]]:
    recording = BagRecording(path, given)
    return recording, list(recording)


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_bag(tmp_path: Path, name: str) -> None:
    """Depth is in the bag's unit, with its camera and the times of the images."""
    recording, frames = read(KINDS[name](tmp_path / name, DEPTH))
    assert recording.camera == Camera("ros", 60.5, 61.5, 31.25, 23.75, 64, 48)
    assert recording.unit_mm == (0.1 if "realsense" in name else 1.0)
    assert (recording.count, recording.cut) == (4, "")
    assert times_of(frames) == pytest.approx([i * bags.STEP_NS / 1e9 for i in range(4)], abs=1e-12)
    assert [f.number for f in frames] == list(range(4))
    assert all(
        np.array_equal(f.depth, d * np.float32(recording.unit_mm)) for f, d in zip(frames, DEPTH)
    )
    assert len(list(recording)) == 4  # a second iteration starts at the first frame


@pytest.mark.parametrize(
    ("values", "options", "unit_mm"),
    [
        (DEPTH[0], {"padding": 6}, 1.0),
        (DEPTH[0], {"padding": 3, "big": True, "encoding": "mono16"}, 1.0),
        (DEPTH[0].astype(np.float32) / 1000, {"encoding": "32FC1"}, 1000.0),
        (
            DEPTH[0].astype(np.float32) / 1000,
            {"encoding": "32FC1", "big": True, "padding": 2},
            1000.0,
        ),
    ],
)
def test_layouts_of_images(
    tmp_path: Path, values: Any, options: dict[str, Any], unit_mm: float
) -> None:
    """Padded rows, both byte orders, and millimetres or metres are read."""
    message = bags.Messages(True).image(values, 5, **options)
    recording, frames = read(bags.write_ros1(tmp_path / "a.bag", DEPTH, make=images((message, 5))))
    assert recording.unit_mm == unit_mm
    np.testing.assert_allclose(frames[0].depth, DEPTH[0], rtol=1e-6)


def compressed(
    content: bytes, form: str, ending: str = "/compressed", topic: str = bags.TOPIC
) -> Any:
    """A function that makes a bag of a camera and one compressed image."""

    def make(of: bags.Messages, depth: bags.Depth) -> bags.Content:
        return [
            *bags.driver(of, depth[:0], topic),
            (f"{topic}{ending}", COMPRESSED, 5, of.compressed(content, 5, form)),
        ]

    return make


@pytest.mark.parametrize("write", [bags.write_ros1, bags.write_ros2])
@pytest.mark.parametrize(
    ("form", "ending", "content"),
    [
        ("16UC1; png compressed ", "/compressed", png(DEPTH[0])),
        ("16UC1; png compressed", "/compressed", png(DEPTH[0])),
        ("mono16; png compressed ", "/compressed", png(DEPTH[0])),
        ("png", "/compressed", png(DEPTH[0])),
        ("", "", png(DEPTH[0])),
        ("16UC1; tiff compressed ", "/compressed", png(DEPTH[0], ".tiff")),
        ("16UC1; compressedDepth", "/compressedDepth", bytes(12) + png(DEPTH[0])),
    ],
)
def test_compressed_images(
    tmp_path: Path, write: Any, form: str, ending: str, content: bytes
) -> None:
    """Depth as PNG or TIFF has the stored values, in mm, and the camera of the image's topic."""
    recording, frames = read(
        write(tmp_path / "a.bag", DEPTH, make=compressed(content, form, ending))
    )
    assert (recording.camera.fx, recording.unit_mm) == (bags.K[0], 1.0)
    assert np.array_equal(frames[0].depth, DEPTH[0])


RECT = [70.0, 0, 30, 0, 0, 71, 20, 0, 0, 0, 1, 0]
NONE = {"k": [0] * 9, "p": [0] * 12}  # not calibrated
REGION = {"sensor": (100, 200)}  # images of a region of the sensor, or of binned pixels


@pytest.mark.parametrize(
    ("options", "given", "camera"),
    [
        (
            {"topic": "/camera/depth/image_rect", "d": (0.2, 0.1, 0, 0, 0), "p": RECT},
            UNKNOWN,
            (70, 71, 30, 20),
        ),
        (NONE, GIVEN, (60, 60, 32, 24)),
        (REGION, GIVEN, (60, 60, 32, 24)),
        ({"sensor": (0, 0)}, UNKNOWN, (60.5, 61.5, 31.25, 23.75)),
    ],
)
def test_cameras(
    tmp_path: Path, options: dict[str, Any], given: CameraInfo, camera: tuple[float, ...]
) -> None:
    """Of rectified images; a given one in place of one that does not fit; of images whose
    size is not said.
    """
    path = bags.write_ros1(
        tmp_path / "a.bag", DEPTH, make=functools.partial(bags.driver, **options)
    )
    found, frames = read(path, given)
    assert found.camera == Camera(found.camera.name, *camera, 64, 48)
    assert np.array_equal(frames[0].depth, DEPTH[0])


@pytest.mark.parametrize(
    ("model", "d", "lens"),
    [
        (
            "Inverse Brown Conrady",
            (0.2, 0.1, 0, 0, 0),
            Lens((0.2, 0.1, 0, 0, 0), "inverse_brown_conrady"),
        ),
        ("", (), Lens()),
    ],
)
def test_lenses(tmp_path: Path, model: str, d: tuple[float, ...], lens: Lens) -> None:
    make = functools.partial(bags.driver, model=model, d=d)
    path = bags.write_ros1(tmp_path / "a.bag", DEPTH, make=make)
    own, frames = read(path)
    _, same = read(path, CameraInfo(own.camera, lens))
    assert np.array_equal(frames[0].depth, same[0].depth)
    assert np.array_equal(frames[0].depth, DEPTH[0]) == lens.is_straight


def test_several_topics_of_depth(tmp_path: Path) -> None:
    """One is named after the bag."""
    aligned = "/camera/aligned_depth_to_color/image_raw"

    def make(of: bags.Messages, depth: bags.Depth) -> bags.Content:
        K = [90, 0, 30, 0, 90, 20, 0, 0, 1]
        return bags.driver(of, depth) + bags.driver(of, depth[:2], aligned, k=K)

    path = bags.write_ros1(tmp_path / "a.bag", DEPTH, make=make)
    with pytest.raises(
        DataError, match=f"depth of 2 topics: {aligned}, /camera/depth/image_raw; name one by"
    ):
        BagRecording(path, UNKNOWN)
    recording, frames = read(Path(f"{path}#{aligned}"))
    assert open_recording(f"{path}#{aligned}").camera == recording.camera
    assert (recording.camera.fx, recording.count, len(frames)) == (90, 2, 2)
    with pytest.raises(DataError, match=r"no images of '/camera/depth/image_rw' \(did you mean"):
        BagRecording(Path(f"{path}#/camera/depth/image_rw"), CameraInfo())


def test_other_topics_than_depth(tmp_path: Path) -> None:
    """Infrared, colours, and the compressed copy of an image."""

    def make(of: bags.Messages, depth: bags.Depth) -> bags.Content:
        return [
            ("/camera/ir/image_raw", IMAGE, 1, of.image(depth[0], 1, "mono16")),
            ("/camera/color/image_raw", IMAGE, 1, of.image(depth[0], 1, "rgb8")),
            (f"{bags.TOPIC}/compressedDepth", COMPRESSED, 1, of.packed(depth[0], 1)),
            *bags.driver(of, depth),
        ]

    assert len(read(bags.write_ros1(tmp_path / "a.bag", DEPTH, make=make))[1]) == 4


def test_images_without_stamps(tmp_path: Path) -> None:
    first, second = (IMAGE_OF(depth, 0) for depth in DEPTH[:2])
    make = images((first, 10**9), (second, 3 * 10**9))
    assert [f.time for f in read(bags.write_ros1(tmp_path / "a.bag", DEPTH, make=make))[1]] == [
        0.0,
        2.0,
    ]


def test_the_same_image_again(tmp_path: Path) -> None:
    """A repeated image is omitted, and a remark reports it."""
    sent = [
        (IMAGE_OF(DEPTH[i], ns), 10 + k)
        for k, (i, ns) in enumerate([(0, 10**9), (0, 10**9), (1, 2 * 10**9)])
    ]
    recording, frames = read(bags.write_ros1(tmp_path / "a.bag", DEPTH, make=images(*sent)))
    assert [(f.number, f.time) for f in frames] == [(0, 0.0), (2, 1.0)]
    assert recording.remarks == (
        "frames left out because they are not later than the one before: 1",
    )


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("plain.bag", "cannot read the bag.*rosbag reindex"),
        ("sqlite", "cannot read the bag: damaged or cut: "),
        ("mcap", "cannot read the bag: damaged or cut: "),
    ],
)
def test_a_truncated_bag_is_rejected(tmp_path: Path, name: str, expected: str) -> None:
    """A truncated bag of ROS 1 has no index; the error names the command that repairs it."""
    path = KINDS[name](tmp_path / name, DEPTH)
    file = (
        path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")
    )
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(DataError, match=expected):
        BagRecording(file, UNKNOWN)


def test_frames_before_the_damage_of_a_bag_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``cut`` gives the reason why there are no more."""
    path = KINDS["plain.bag"](tmp_path / "a.bag", DEPTH)
    recording = BagRecording(path, UNKNOWN)
    values_of = ros_bag.values_of
    calls = iter(range(9))

    def failing(message: Any, where: str) -> Any:
        if next(calls) == 2:
            raise EOFError("the chunk ends")
        return values_of(message, where)

    monkeypatch.setattr(ros_bag, "values_of", failing)
    assert len(list(recording)) == 2
    assert recording.cut == "damaged or cut after frame 1: the chunk ends"


def of_rows(rows: int) -> bytes:
    """An image whose header announces this number of rows."""
    size = struct.Struct("<II")
    return bags.Messages(True).image(DEPTH[0], 5).replace(size.pack(48, 64), size.pack(rows, 64))


IMAGE_OF = bags.Messages(True).image
COLOUR = "/camera/color/image_raw"


@bad_inputs(
    DataError,
    {
        "a camera that is not calibrated": (
            functools.partial(bags.driver, **NONE),
            "...: the camera of these frames ...",
        ),
        "a camera of another size": (
            functools.partial(bags.driver, **REGION),
            "...a.bag: /camera/depth/camera_info: the "
            "camera has 200 x 100 pixels, the images have 64 x 48; expected the same; ...",
        ),
        "a lens that is not known": (
            functools.partial(bags.driver, model="equidistant", d=(0.2, 0.1, 0, 0)),
            "...a.bag: /camera/depth/camera_info: distortion model 'equidistant' is not ...",
        ),
        "colours": (
            images((IMAGE_OF(DEPTH[0], 5, "rgb8"), 5), topic=COLOUR),
            f"...a.bag: no images of depth, which have the encoding 16UC1, mono16, 32FC1; it has {COLOUR} of the "
            "encoding 'rgb8'",
        ),
        "an encoding that is not read": (
            images((IMAGE_OF(DEPTH[0], 5, "64FC1"), 5)),
            f"...a.bag: no images of depth, ...; it has {bags.TOPIC} of the encoding '64FC1'",
        ),
        "colours as PNG": (
            compressed(png(np.zeros((48, 64, 3), np.uint8)), "png", topic=COLOUR),
            f"...a.bag: no images of depth, ...; it has {COLOUR}/compressed of the encoding '...'",
        ),
        "too few bytes": (
            images((of_rows(49), 5)),
            f"...a.bag: {bags.TOPIC}: 6144 bytes in rows of 128, which are no 64 x 49 pixels of 16UC1",
        ),
        **{
            form: (compressed(content, form), f"...a.bag: {bags.TOPIC}/compressed: {line}")
            for form, content, line in (
                *(
                    (
                        form,
                        content,
                        f"compressed depth of the format '{form}'; expected a PNG or TIFF of 16 bits (of others, ...",
                    )
                    for form, content in (
                        ("16UC1; jpeg compressed", b"\xff\xd8\xff"),
                        ("16UC1; compressedDepth rvl", bytes(12) + b"none"),
                        ("32FC1; compressedDepth png", bytes(12) + png(DEPTH[0])),
                    )
                ),
                (
                    "16UC1; png compressed ",
                    png(DEPTH[0].astype(np.uint8)),
                    "a picture of uint8 (48, 64), expected 16-bit ...",
                ),
            )
        },
    },
)
def test_invalid_bags_are_rejected(tmp_path: Path, given: Any, rejected: Any) -> None:
    """Other lenses and topics, compression that does not preserve depth, and damage
    raise an error.
    """
    with rejected:
        read(bags.write_ros1(tmp_path / "a.bag", DEPTH, make=given))


@bad_inputs(
    DataError,
    {
        text: f"...a: ...option/Depth_Units/value: depth units of '{text}' m; expected a number between 0 and 1"
        for text in ("e", "1e", "--", "", "2", "0", "nan")
    },
)
def test_invalid_depth_units_are_rejected(tmp_path: Path, given: str, rejected: Any) -> None:
    """The unit of the depth in a .db3 of RealSense is a number of metres."""

    def make(of: bags.Messages, depth: bags.Depth) -> bags.Content:
        content = bags.realsense_db3(of, depth)
        return [
            (topic, kind, ns, of.text(given) if "option" in topic else it)
            for topic, kind, ns, it in content
        ]

    with rejected:
        BagRecording(bags.write_ros2(tmp_path / "a", DEPTH, make=make), UNKNOWN)


def test_without_rosbags(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(NetlibError, match="pip install rosbags"):
        BagRecording(tmp_path / "a.bag", CameraInfo())
