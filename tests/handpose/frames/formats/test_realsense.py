"""A live RealSense: with a fake of pyrealsense2, and with the software device of
the real module.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats import realsense
from handpose.frames.formats.realsense import open_live
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError, NetlibError
from tests.handpose.frames.conftest import times_of
from tests.support.bad_input import bad_inputs

SENT = [(10 + i, 5000 + i * 33.0) for i in range(4)]  # frame numbers, and times in ms


class FakeModule:
    """The used part of pyrealsense2, with a camera that sends the frames SENT and is
    then unplugged.
    """

    def __init__(self) -> None:
        self.stopped = 0
        self.stream = SimpleNamespace(depth="depth")
        self.format = SimpleNamespace(z16="z16")
        self.camera_info = SimpleNamespace(name="name", serial_number="serial_number")
        self.intrinsics = SimpleNamespace(
            width=64,
            height=48,
            fx=60.5,
            fy=61.5,
            ppx=31.25,
            ppy=23.75,
            model="distortion.brown_conrady",
            coeffs=[0.0] * 5,
        )
        self.video_stream_profile = SimpleNamespace(
            get_intrinsics=lambda: self.intrinsics, fps=lambda: 30, format=lambda: "z16"
        )
        self.video_stream_profile.as_video_stream_profile = lambda: self.video_stream_profile
        self.depth_sensor = SimpleNamespace(get_depth_scale=lambda: float(np.float32(0.0001)))
        self.device = SimpleNamespace(
            get_info={"name": "Fake D400", "serial_number": "0123"}.__getitem__,
            first_depth_sensor=lambda: self.depth_sensor,
        )
        self.pipeline_profile = SimpleNamespace(
            get_stream=lambda stream: self.video_stream_profile, get_device=lambda: self.device
        )
        self._frames = iter([self.depth_frame(*frame) for frame in SENT])

    @staticmethod
    def depth_frame(number: int, time_ms: float) -> Any:
        return SimpleNamespace(
            get_frame_number=lambda: number,
            get_timestamp=lambda: time_ms,
            get_frame_timestamp_domain=lambda: "hardware",
            get_data=lambda: np.full((48, 64), number, np.uint16) + np.arange(64, dtype=np.uint16),
        )

    def context(self) -> Any:
        return SimpleNamespace(query_devices=lambda: [self.device])

    def config(self) -> Any:
        config = SimpleNamespace(serial="", enable_stream=lambda stream: None)
        config.enable_device = lambda serial: setattr(config, "serial", serial)
        return config

    def pipeline(self) -> Any:
        return SimpleNamespace(
            start=self._start, stop=self._stop, wait_for_frames=self._wait_for_frames
        )

    def _start(self, config: Any) -> Any:
        if config.serial not in ("", "0123"):
            raise RuntimeError("No device connected")
        return self.pipeline_profile

    def _stop(self) -> None:
        self.stopped += 1
        if self.stopped > 1:
            raise RuntimeError("stop() cannot be called before start()")

    def _wait_for_frames(self, timeout_ms: int) -> Any:
        frame = next(self._frames, None)
        if frame is None:
            raise RuntimeError(f"Frame didn't arrive within {timeout_ms}")
        return SimpleNamespace(get_depth_frame=lambda: frame)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeModule:
    module = FakeModule()
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    return module


def test_a_camera_is_read_until_it_is_unplugged(fake: FakeModule) -> None:
    """Depth is in the camera's unit, with its numbers and times."""
    with open_live("0123", UNKNOWN) as recording:
        assert recording.camera == Camera("Fake D400 0123", 60.5, 61.5, 31.25, 23.75, 64, 48)
        assert (recording.unit_mm, recording.rate, recording.live, recording.count) == (
            0.1,
            30,
            True,
            None,
        )
        frames = list(recording)
        assert [f.number for f in frames] == [0, 1, 2, 3]
        assert times_of(frames) == pytest.approx([0, 0.033, 0.066, 0.099])
        assert [f.depth[0, 0] for f in frames] == pytest.approx([1.0, 1.1, 1.2, 1.3])
        assert "was the camera unplugged" in recording.cut
        assert recording.remarks == ()
    recording.close()  # closing twice is harmless
    assert fake.stopped == 2


@bad_inputs(
    DataError,
    {
        "another serial number": (
            ("999", 60.5, UNKNOWN),
            (
                "realsense: camera 999 cannot be started: No device connected; connected: 0123 "
                "(no other program may use it)"
            ),
        ),
        "no focal length": (
            (None, 0.0, UNKNOWN),
            "Fake D400 0123: camera 'Fake D400 0123': fx is 0.0, expected more than 1e-06 px",
        ),
        "another size": (
            (None, 60.5, CameraInfo(Camera("own", 60, 60, 32, 24, 640, 480))),
            "Fake D400 0123: 64 x 48 pixels (if ...: --camera ...); camera own has 640 x 480",
        ),
    },
)
def test_a_camera_that_does_not_fit(fake: FakeModule, given: Any, rejected: Any) -> None:
    """An unknown number lists the cameras connected; a camera that does not fit is stopped."""
    number, fake.intrinsics.fx, info = given
    with rejected:
        open_live(number, info)
    assert fake.stopped == (number is None)


@bad_inputs(
    NetlibError,
    {
        "not installed": (
            ModuleNotFoundError("No module named 'pyrealsense2'"),
            "pyrealsense2 is missing: pip install pyrealsense2",
        ),
        "no libusb": (
            ImportError("libusb-1.0.so.0: cannot open shared object file"),
            "pyrealsense2 cannot be loaded: libusb-1.0.so.0: cannot open shared object file: apt install libusb-1.0-0",
        ),
    },
)
def test_without_the_package(
    monkeypatch: pytest.MonkeyPatch, given: ImportError, rejected: Any
) -> None:
    class Finder:
        def find_spec(self, name: str, *others: object) -> None:
            if name == "pyrealsense2":
                raise given

    monkeypatch.delitem(sys.modules, "pyrealsense2", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Finder(), *sys.meta_path])
    with rejected:
        open_live(None, UNKNOWN)


@pytest.fixture
def rs() -> Any:
    return pytest.importorskip(
        "pyrealsense2", reason="pyrealsense2 is missing, or libusb", exc_type=ImportError
    )


def test_the_stand_in_is_like_the_real_one(rs: Any) -> None:
    fake = FakeModule()
    for name, parts in vars(fake).items():
        if isinstance(parts, SimpleNamespace):
            assert [part for part in vars(parts) if not hasattr(getattr(rs, name), part)] == [], (
                name
            )
    for name, made in (
        ("context", fake.context()),
        ("config", fake.config()),
        ("pipeline", fake.pipeline()),
        ("depth_frame", fake.depth_frame(0, 0)),
    ):
        assert [
            part for part in vars(made) if part != "serial" and not hasattr(getattr(rs, name), part)
        ] == [], name
    assert hasattr(rs.composite_frame, "get_depth_frame")


@pytest.fixture
def software(rs: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A function that sends a frame of a software device, given its number, time and value."""
    device = rs.software_device()
    for key, value in ((rs.camera_info.name, "Software"), (rs.camera_info.serial_number, "0123")):
        device.register_info(key, value)
    sensor = device.add_sensor("Stereo Module")
    numbers = rs.intrinsics()
    numbers.width = 64
    numbers.height = 48
    numbers.model = rs.distortion.brown_conrady
    numbers.coeffs = [0.0] * 5
    numbers.fx, numbers.fy, numbers.ppx, numbers.ppy = 60.5, 61.5, 31.25, 23.75
    stream = rs.video_stream()
    stream.type = rs.stream.depth
    stream.index = 0
    stream.uid = 0
    stream.fmt = rs.format.z16
    stream.bpp = 2
    stream.width, stream.height, stream.fps, stream.intrinsics = 64, 48, 30, numbers
    profile = sensor.add_video_stream(stream, True).as_video_stream_profile()
    sensor.add_read_only_option(rs.option.depth_units, 0.0001)
    pipeline = rs.pipeline()
    pipeline.set_device(device)
    monkeypatch.setattr(rs, "pipeline", lambda: pipeline)

    def send(number: int, time_ms: float, value: int) -> None:
        frame = rs.software_video_frame()
        frame.pixels, frame.stride, frame.bpp = np.full((48, 64), value, np.uint16), 128, 2
        frame.timestamp = time_ms
        frame.domain = rs.timestamp_domain.hardware_clock
        frame.frame_number = number
        frame.profile = profile
        frame.depth_units = 0.0001
        sensor.on_video_frame(frame)

    yield send


def test_the_real_module(software: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames of a software device are read one by one, until it sends no more."""
    monkeypatch.setattr(realsense, "WAIT_MS", 60_000)
    with open_live(None, UNKNOWN) as recording:
        assert recording.camera == Camera("Software 0123", 60.5, 61.5, 31.25, 23.75, 64, 48)
        assert (recording.unit_mm, recording.rate) == (0.1, 30.0)
        frames = iter(recording)
        for i, number in enumerate((10, 11, 13)):
            sender = threading.Thread(
                target=software, args=(number, 1000 + 33.0 * (number - 10), 1000 + i)
            )
            sender.start()
            frame = next(frames)
            sender.join()
            since = number - 10
            assert (frame.number, frame.time) == (since, pytest.approx(0.033 * since, abs=5e-7))
            assert (frame.depth == np.float32(1000 + i) * np.float32(0.1)).all()
        monkeypatch.setattr(realsense, "WAIT_MS", 1)
        assert list(frames) == []
        assert "was the camera unplugged" in recording.cut
        assert recording.remarks == ("frames lost because they were not taken in time: 1",)
