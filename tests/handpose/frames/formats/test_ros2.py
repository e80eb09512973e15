"""A live ROS 2 topic: with a stand-in for rclpy and sensor_msgs that sends messages one by one."""

from __future__ import annotations

import array
import sys
from collections import deque
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats import ros2
from handpose.frames.formats.ros2 import open_live
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError, NetlibError
from tests.support.bad_input import bad_inputs
from tests.support.bags import K

TOPIC, INFO = "/camera/depth/image_rect_raw", "/camera/depth/camera_info"
GIVEN = CameraInfo(Camera("own", 60, 60, 32, 24, 0, 0), origin="--camera")


class StandIn:
    """The used part of rclpy: each spin delivers the next message, given as its topic and itself."""

    def __init__(self, *sent: tuple[str, Any]) -> None:
        self.sent, self.calls, self.subscribed = deque(sent), [], {}
        self.is_ok = False
        self.qos = SimpleNamespace(
            QoSProfile=lambda depth, reliability: (depth, reliability),
            ReliabilityPolicy=SimpleNamespace(BEST_EFFORT="best effort"),
        )
        self.signals = SimpleNamespace(SignalHandlerOptions=SimpleNamespace(NO="no"))

    def ok(self) -> bool:
        return self.is_ok

    def init(self, signal_handler_options: str) -> None:
        self.calls.append(f"init {signal_handler_options}")

    def create_node(self, name: str) -> Any:
        return SimpleNamespace(
            create_subscription=self.subscribe, destroy_node=lambda: self.calls.append(f"destroy {name}")
        )

    def subscribe(self, kind: str, topic: str, callback: Any, qos: tuple[int, str]) -> None:
        self.subscribed[topic] = (kind, callback, qos)

    def spin_once(self, node: Any, timeout_sec: float) -> None:
        if self.sent:
            topic, message = self.sent.popleft()
            self.subscribed[topic][1](message)

    def try_shutdown(self) -> None:
        self.calls.append("shutdown")


def plug_in(monkeypatch: pytest.MonkeyPatch, *sent: tuple[str, Any]) -> StandIn:
    module = StandIn(*sent)
    types = SimpleNamespace(Image="Image", CompressedImage="CompressedImage", CameraInfo="CameraInfo")
    for name, part in (("rclpy", module), ("rclpy.qos", module.qos), ("rclpy.signals", module.signals),
                       ("sensor_msgs", SimpleNamespace(msg=types)), ("sensor_msgs.msg", types)):
        monkeypatch.setitem(sys.modules, name, part)
    monkeypatch.setattr(ros2, "WAIT_S", 0.0 if not sent else ros2.WAIT_S)
    return module


def header(seconds: float) -> Any:
    return SimpleNamespace(stamp=SimpleNamespace(sec=int(seconds), nanosec=round(seconds % 1 * 1e9)))


def image(seconds: float, value: float, encoding: str = "16UC1") -> tuple[str, Any]:
    """A message as rclpy makes it: its data is an array of bytes."""
    values = np.full((48, 64), value, np.float32 if encoding == "32FC1" else np.uint16)
    return TOPIC, SimpleNamespace(
        header=header(seconds), height=48, width=64, encoding=encoding, is_bigendian=0, step=values.strides[0],
        data=array.array("B", values.tobytes()),
    )


def info(k: list[float] = K, binning: int = 0) -> tuple[str, Any]:
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    size = max(1, binning)
    return INFO, SimpleNamespace(
        k=np.array(k), d=[0.0] * 5, p=np.array([k[0], 0, k[2], 0, 0, k[4], k[5], 0, 0, 0, 1, 0]), roi=roi,
        width=64 * size, height=48 * size, binning_x=binning, binning_y=binning, distortion_model="plumb_bob",
    )


def test_frames_as_they_come(monkeypatch: pytest.MonkeyPatch) -> None:
    """Depth in mm with the times of the messages; the first image tells the size, camera_info the camera."""
    module = plug_in(monkeypatch, info(), image(9.0, 500), image(9.1, 501), info(), image(9.25, 502))
    with open_live(TOPIC, UNKNOWN) as recording:
        assert recording.camera == Camera("ros", K[0], K[4], K[2], K[5], 64, 48)
        assert (recording.name, recording.unit_mm, recording.live) == (f"ros2:{TOPIC}", 1.0, True)
        frames = list(recording)
    assert [(f.number, round(f.time, 3), f.depth[0, 0]) for f in frames] == [(0, 0.0, 501), (1, 0.15, 502)]
    assert recording.cut == "no frame for 5 s; was the camera unplugged?"
    assert {topic: (kind, qos) for topic, (kind, _, qos) in module.subscribed.items()} == {
        TOPIC: ("Image", (1, "best effort")), INFO: ("CameraInfo", (1, "best effort"))}
    assert module.calls == ["init no", "destroy handpose", "shutdown"]


def test_a_context_of_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the program has initialised rclpy, it is not shut down."""
    module = plug_in(monkeypatch, info(), image(9.0, 500))
    module.is_ok = True
    open_live(TOPIC, UNKNOWN).close()
    assert module.calls == ["destroy handpose"]


def test_metres_and_binning(monkeypatch: pytest.MonkeyPatch) -> None:
    """32FC1 is metres, and a binned image has the camera of its pixels."""
    plug_in(monkeypatch, info(binning=2), image(9.0, 0.5, "32FC1"), image(0.0, 0.75, "32FC1"))
    recording = open_live(TOPIC, UNKNOWN)
    assert (recording.camera.fx, recording.unit_mm) == (K[0] / 2, 1000)
    assert [f.depth[0, 0] for f in recording] == [750]


def test_compressed_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """A topic that ends in /compressedDepth has messages of the type CompressedImage."""
    png = bytes(12) + cv2.imencode(".png", np.full((48, 64), 700, np.uint16))[1].tobytes()
    form, data = "16UC1; compressedDepth png", array.array("B", png)
    sent = [(f"{TOPIC}/compressedDepth", SimpleNamespace(header=header(s), format=form, data=data)) for s in (1, 2)]
    module = plug_in(monkeypatch, sent[0], info(), sent[1])
    (one,) = open_live(f"{TOPIC}/compressedDepth", UNKNOWN)
    assert one.depth[0, 0] == 700
    assert module.subscribed[f"{TOPIC}/compressedDepth"][0] == "CompressedImage"


def test_a_given_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a given camera, camera_info is not needed, and an uncalibrated one is ignored."""
    for sent in ([image(9.0, 500)], [info([0.0] * 9), image(9.0, 500)]):
        plug_in(monkeypatch, *sent)
        assert open_live(TOPIC, GIVEN).camera.fx == 60


@bad_inputs(DataError, {
    "not calibrated": ([info([0.0] * 9), image(9.0, 500)],
                       f"ros2:{TOPIC}: {INFO} has a camera that is not calibrated; give --camera"),
    "no message": ([], f"ros2:{TOPIC}: no message on {TOPIC} for 0 s"),
    "no camera_info": ([image(1.0, 500)], f"ros2:{TOPIC}: no message on {INFO} for 0 s; give --camera"),
})
def test_without_messages(monkeypatch: pytest.MonkeyPatch, given: list[tuple[str, Any]], rejected: Any) -> None:
    """If no image or no valid camera_info comes, the error names the topic, and the node is destroyed."""
    module = plug_in(monkeypatch, *given)
    monkeypatch.setattr(ros2, "WAIT_S", 0.0 if len(given) < 2 else ros2.WAIT_S)
    with rejected:
        open_live(TOPIC, UNKNOWN)
    assert module.calls[-2:] == ["destroy handpose", "shutdown"]


@bad_inputs(DataError, {
    "no topic": (None, "ros2: expected a topic, as in ros2:/camera/depth/image_rect_raw"),
    "no package": (TOPIC, NetlibError, "rclpy is missing: it is a part of ROS 2 (apt install ..."),
})
def test_without_a_topic_or_the_package(monkeypatch: pytest.MonkeyPatch, given: str | None, rejected: Any) -> None:
    """The errors name an example, and the command that installs ROS."""
    if given:
        monkeypatch.setitem(sys.modules, "rclpy", None)
    with rejected:
        open_live(given, UNKNOWN)
