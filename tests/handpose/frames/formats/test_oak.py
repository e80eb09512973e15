"""A live OAK-D: with a stand-in for depthai, whose names are compared with the real module if it is installed."""

from __future__ import annotations

import sys
from collections import deque
from datetime import timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats.oak import open_live
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError, NetlibError
from tests.support.bad_input import bad_inputs

MATRIX = [[60.5, 0.0, 31.25], [0.0, 61.5, 23.75], [0.0, 0.0, 1.0]]


class Connection:
    """The class Device: called to connect to a device, and with the method that lists them."""

    def __init__(self, module: StandIn) -> None:
        self._module = module

    def __call__(self, info: str | None = None) -> Any:
        return self._module.connect(info)

    def getAllAvailableDevices(self) -> list[Any]:
        return [SimpleNamespace(getDeviceId=lambda name=name: name) for name in self._module.ids]


class StandIn:
    """The used part of depthai, with a device that sends the frames of these numbers and is then unplugged."""

    __version__ = "3.0.0"
    CameraBoardSocket = SimpleNamespace(CAM_B="CAM_B", CAM_C="CAM_C")

    def __init__(self, *numbers: int) -> None:
        self.ids, self.calls, self.links = ["14442C1"], [], []
        self.matrix, self.frames = MATRIX, deque(self.frame(number) for number in numbers)
        self.node = SimpleNamespace(Camera="Camera", StereoDepth="StereoDepth")
        self.Device = Connection(self)

    @staticmethod
    def DeviceInfo(name: str) -> str:
        return name

    def connect(self, info: str | None) -> Any:
        if (info or "14442C1") not in self.ids:
            raise RuntimeError("No available devices")
        return SimpleNamespace(
            getDeviceName=lambda: "OAK-D", getDeviceId=lambda: "14442C1", close=lambda: self.calls.append("close")
        )

    def Pipeline(self, device: Any) -> Any:
        return SimpleNamespace(
            create=self.create, start=lambda: self.calls.append("start"), stop=lambda: self.calls.append("stop")
        )

    def create(self, kind: str) -> Any:
        if kind == "StereoDepth":
            switches = ("setLeftRightCheck", "setSubpixel", "setExtendedDisparity")
            depth = SimpleNamespace(createOutputQueue=self.queue)
            return SimpleNamespace(
                left="left",
                right="right",
                depth=depth,
                **dict.fromkeys(switches, lambda is_on: self.calls.append(is_on)),
            )
        return SimpleNamespace(build=lambda socket: SimpleNamespace(requestOutput=lambda size, fps: SimpleNamespace(
            link=lambda side: self.links.append((socket, size, fps, side)))))

    def queue(self, maxSize: int, blocking: bool) -> Any:
        self.calls.append((maxSize, blocking))
        return SimpleNamespace(get=self.get)

    def get(self, timeout: timedelta) -> Any:
        if not self.frames:
            raise RuntimeError("Communication exception")
        return self.frames.popleft()

    def frame(self, number: int) -> Any:
        return SimpleNamespace(
            getFrame=lambda: np.full((48, 64), 500 + number, np.uint16), getSequenceNum=lambda: number,
            getTimestampDevice=lambda: timedelta(seconds=7 + number / 30), getWidth=lambda: 64, getHeight=lambda: 48,
            getTransformation=lambda: SimpleNamespace(getIntrinsicMatrix=lambda: self.matrix),
        )


def plug_in(monkeypatch: pytest.MonkeyPatch, *numbers: int) -> StandIn:
    module = StandIn(*numbers)
    monkeypatch.setitem(sys.modules, "depthai", module)
    return module


def test_frames_as_they_come(monkeypatch: pytest.MonkeyPatch) -> None:
    """Depth is in mm, with the device's numbers and times; the first frame tells the camera."""
    module = plug_in(monkeypatch, 3, 4, 5, 8)
    with open_live(None, UNKNOWN) as recording:
        assert recording.camera == Camera("OAK-D 14442C1", 60.5, 61.5, 31.25, 23.75, 64, 48)
        assert (recording.unit_mm, recording.rate, recording.live, recording.count) == (1, 30, True, None)
        frames = list(recording)
    assert [(f.number, round(f.time, 3)) for f in frames] == [(0, 0.0), (1, 0.033), (4, 0.133)]
    assert [f.depth[0, 0] for f in frames] == [504, 505, 508]
    assert "Communication exception" in recording.cut
    assert recording.remarks == ("frames lost because they were not taken in time: 2",)
    assert module.links == [("CAM_B", (640, 400), 30.0, "left"), ("CAM_C", (640, 400), 30.0, "right")]
    assert module.calls == [True, True, True, (1, False), "start", "stop", "close"]


def test_a_device_by_its_identifier(monkeypatch: pytest.MonkeyPatch) -> None:
    """A device is selected by its identifier; for an unknown one the error lists those connected."""
    plug_in(monkeypatch, 1)
    assert open_live("14442C1", UNKNOWN).name == "OAK-D 14442C1"
    with pytest.raises(DataError, match="device X9 cannot be started: No available devices; connected: 14442C1"):
        open_live("X9", UNKNOWN)


@bad_inputs(DataError, {
    "no focal length": (([[0.0] * 3] * 3, UNKNOWN),
                        "OAK-D 14442C1: camera 'OAK-D 14442C1': fx is 0.0, expected more than 1e-06 px"),
    "another size": ((MATRIX, CameraInfo(Camera("own", 60, 60, 32, 24, 640, 480))),
                     "OAK-D 14442C1: 64 x 48 pixels; camera own has 640 x 480"),
    "no depth": ((MATRIX, None), "OAK-D 14442C1: no frame of depth; has it two cameras?"),
})
def test_a_camera_that_does_not_fit(monkeypatch: pytest.MonkeyPatch, given: Any, rejected: Any) -> None:
    """If the camera cannot be used or sends no depth, the device is closed."""
    module = plug_in(monkeypatch, 1)
    module.matrix, info = given
    if info is None:
        monkeypatch.setattr(module, "get", lambda timeout: None)
    with rejected:
        open_live(None, info or UNKNOWN)
    assert module.calls[-2:] == ["stop", "close"]


@bad_inputs(NetlibError, {
    "version 2": (SimpleNamespace(__version__="2.0.0", node=SimpleNamespace(MonoCamera=None)),
                  "depthai 2.0.0 is too old: pip install 'depthai>=3'"),
    "none": (None, "depthai is missing: pip install 'depthai>=3' (...)"),
})
def test_without_the_package(monkeypatch: pytest.MonkeyPatch, given: Any, rejected: Any) -> None:
    """The error names the command that installs the package, also for one of version 2."""
    monkeypatch.setitem(sys.modules, "depthai", given)
    with rejected:
        open_live(None, UNKNOWN)


def test_the_stand_in_is_like_the_real_one() -> None:
    """Every name of the stand-in that is used exists in the real module."""
    dai = pytest.importorskip("depthai", reason="depthai is missing", exc_type=ImportError)
    module = StandIn()
    camera = module.create("Camera")
    pairs = ((module.connect(None), dai.Device), (module.Pipeline(None), dai.Pipeline), (camera, dai.node.Camera),
             (camera.build(""), dai.node.Camera), (camera.build("").requestOutput((1, 1), 1), dai.Node.Output),
             (module.create("StereoDepth"), dai.node.StereoDepth), (module.queue(1, False), dai.MessageQueue),
             (module.create("StereoDepth").depth, dai.Node.Output), (module.frame(0), dai.ImgFrame),
             (module.frame(0).getTransformation(), dai.ImgTransformation), (module.node, dai.node),
             (module.CameraBoardSocket, dai.CameraBoardSocket),
             (module.Device.getAllAvailableDevices()[0], dai.DeviceInfo))
    for made, real in pairs:
        assert [name for name in vars(made) if not hasattr(real, name)] == [], real
    assert hasattr(dai.Device, "getAllAvailableDevices")
