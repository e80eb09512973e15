"""A live Orbbec camera: a stand-in for pyorbbecsdk, whose names are compared with the real module where that is."""

from __future__ import annotations

import itertools
import sys
import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats.orbbec import open_live
from handpose.frames.lens import Lens
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError, NetlibError
from tests.support.bad_input import bad_inputs

DISTORTION = {"k1": 0.1, "k2": -0.05, "k3": 0.01, "k4": 0.0, "k5": 0.0, "k6": 0.0, "p1": 0.0, "p2": 0.0}


class StandIn:
    """The used part of pyorbbecsdk, with a camera of frames 0, 1, ... that waits for each to be asked for."""

    OBError = type("OBError", (Exception,), {})
    OBFormat = SimpleNamespace(Y16="Y16", Z16="Z16")
    OBSensorType = SimpleNamespace(DEPTH_SENSOR="DEPTH_SENSOR")

    def __init__(self, model: str = "NONE", **distortion: float) -> None:
        self.stopped, self.format, self.serials = 0, "Y16", ["CP1"]
        self.intrinsic = SimpleNamespace(fx=60.5, fy=61.5, cx=31.25, cy=23.75, width=64, height=48)
        numbers = dict.fromkeys(DISTORTION, 0.0) | distortion
        self.profile = SimpleNamespace(
            get_intrinsic=lambda: self.intrinsic, get_fps=lambda: 30,
            get_distortion=lambda: SimpleNamespace(model=SimpleNamespace(name=model), **numbers),
        )
        self.numbers = itertools.count()
        self.asked = threading.Semaphore(1)  # the first frame is read when the camera is opened
        self.end: Any = None  # what follows when the camera is asked for no more frames

    def Context(self) -> Any:
        return SimpleNamespace(query_devices=lambda: SimpleNamespace(
            get_count=lambda: len(self.serials), get_device_serial_number_by_index=self.serials.__getitem__,
            get_device_by_serial_number=self.device,
        ))

    def device(self, serial: str) -> Any:
        if serial not in self.serials:
            raise self.OBError("no such device")
        info = SimpleNamespace(get_name=lambda: "Femto", get_serial_number=lambda: serial)
        return SimpleNamespace(get_device_info=lambda: info)

    def Config(self) -> Any:
        return SimpleNamespace(enable_stream=lambda profile: None)

    def Pipeline(self, device: Any = None) -> Any:
        if not self.serials:
            raise RuntimeError("No device found")
        profiles = SimpleNamespace(get_default_video_stream_profile=lambda: self.profile)
        return SimpleNamespace(
            get_stream_profile_list=lambda sensor: profiles, start=lambda config: None, stop=self.stop,
            wait_for_frames=self.wait_for_frames, get_device=lambda: device or self.device("CP1"),
        )

    def stop(self) -> None:
        self.stopped += 1
        if self.stopped > 1:
            raise self.OBError("not started")

    def wait_for_frames(self, timeout_ms: int) -> Any:
        self.asked.acquire()
        if self.end is not None:
            raise self.end
        return SimpleNamespace(get_depth_frame=lambda: self.frame(next(self.numbers)))

    def frame(self, number: int) -> Any:
        values = np.full((48, 64), 1000 + number, np.uint16)
        return SimpleNamespace(
            get_width=lambda: 64, get_height=lambda: 48, get_format=lambda: self.format, get_index=lambda: 70 + number,
            get_depth_scale=lambda: float(np.float32(0.1)), get_timestamp_us=lambda: 9_000_000 + 33_333 * number,
            get_data=lambda: values.reshape(-1).view(np.uint8),
        )


def plug_in(monkeypatch: pytest.MonkeyPatch, *arguments: Any, **more: Any) -> StandIn:
    module = StandIn(*arguments, **more)
    monkeypatch.setitem(sys.modules, "pyorbbecsdk", module)
    return module


def test_frames_as_they_come(monkeypatch: pytest.MonkeyPatch) -> None:
    """Depth is in the camera's unit, with its numbers and times; an error of the SDK is the reason of the end."""
    module = plug_in(monkeypatch)
    with open_live(None, UNKNOWN) as recording:
        assert recording.camera == Camera("Femto CP1", 60.5, 61.5, 31.25, 23.75, 64, 48)
        assert (recording.unit_mm, recording.rate, recording.live, recording.count) == (0.1, 30, True, None)
        frames, found = iter(recording), []
        for _ in range(3):
            module.asked.release()
            found.append(next(frames))
        assert [f.number for f in found] == [0, 1, 2]
        assert [f.time for f in found] == pytest.approx([0, 0.033333, 0.066666])
        assert [f.depth[0, 0] for f in found] == pytest.approx([100.1, 100.2, 100.3])
        module.end = ValueError("unplugged")
        module.asked.release()
        assert list(frames) == [] and recording.cut == "the camera has stopped: unplugged"
    assert module.stopped == 1


@pytest.mark.parametrize(
    ("model", "numbers", "lens"),
    [
        ("BROWN_CONRADY", DISTORTION, Lens((0.1, -0.05, 0.0, 0.0, 0.01))),
        ("BROWN_CONRADY_K6", DISTORTION | {"k4": 0.02}, Lens((0.1, -0.05, 0.0, 0.0, 0.01, 0.02, 0.0, 0.0))),
        ("NONE", {}, Lens()),
    ],
)
def test_its_lens(monkeypatch: pytest.MonkeyPatch, model: str, numbers: dict[str, float], lens: Lens) -> None:
    """The distortion of the SDK's models is removed."""
    module = plug_in(monkeypatch, model, **numbers)
    own = Camera("own", 60.5, 61.5, 31.25, 23.75, 64, 48)
    for given in (UNKNOWN, CameraInfo(own, lens)):
        with open_live(None, given) as recording:
            module.asked.release()
            depth = next(iter(recording)).depth
            assert (depth > 0).all() == lens.is_straight
            module.end = EOFError()
            module.asked.release()
        module.end = None
        module.asked.release()


@bad_inputs(DataError, {
    "another lens": (("KANNALA_BRANDT4", {}), "Femto CP1: distortion model 'KANNALA_BRANDT4' is not known; known: ..."),
    "another format": (("NONE", {"format": "RLE"}), "Femto CP1: its depth comes as RLE; expected Y16"),
    "no focal length": (("NONE", {"intrinsic": SimpleNamespace(fx=0.0, fy=0.0, cx=0, cy=0, width=64, height=48)}),
                        "Femto CP1: camera 'Femto CP1': fx is 0.0, expected more than 1e-06 px"),
    "another size": (("NONE", {"intrinsic": SimpleNamespace(fx=6.0, fy=6.0, cx=0, cy=0, width=99, height=48)}),
                     "Femto CP1: frames of 64 x 48 pixels; its camera has 99 x 48"),
})
def test_a_camera_that_does_not_fit(monkeypatch: pytest.MonkeyPatch, given: Any, rejected: Any) -> None:
    """A camera that cannot be used is stopped, and the error has its name."""
    model, change = given
    module = plug_in(monkeypatch, model, **(DISTORTION if model != "NONE" else {}))
    for name, value in change.items():
        setattr(module, name, value)
    with rejected:
        open_live(None, UNKNOWN)
    assert module.stopped == 1


@bad_inputs(DataError, {
    "another serial number": (("X9", ["CP1"]),
        "orbbec: camera X9 cannot be started: no such device; connected: CP1 (no other program may use it)"),
    "no camera": ((None, []), "orbbec: a camera cannot be started: No device found; connected: none (...)"),
    "no package": ((None, None), NetlibError, "pyorbbecsdk is missing: pip install pyorbbecsdk2 (...)"),
})
def test_no_camera(monkeypatch: pytest.MonkeyPatch, given: Any, rejected: Any) -> None:
    """Without the camera the error lists those connected, and without the package it names the command."""
    number, connected = given
    plug_in(monkeypatch).serials = connected
    if connected is None:
        monkeypatch.setitem(sys.modules, "pyorbbecsdk", None)
    with rejected:
        open_live(number, UNKNOWN)


def test_the_stand_in_is_like_the_real_one() -> None:
    """Every name of the stand-in that is used exists in the real module."""
    ob = pytest.importorskip("pyorbbecsdk", reason="pyorbbecsdk is missing", exc_type=ImportError)
    module = StandIn()
    pipeline = module.Pipeline()
    pairs = ((pipeline, ob.Pipeline), (module.Config(), ob.Config), (module.profile, ob.VideoStreamProfile),
             (pipeline.get_stream_profile_list(""), ob.StreamProfileList), (module.Context(), ob.Context),
             (module.Context().query_devices(), ob.DeviceList), (module.device("CP1"), ob.Device),
             (module.device("CP1").get_device_info(), ob.DeviceInfo), (module.frame(0), ob.DepthFrame),
             (module.intrinsic, ob.OBCameraIntrinsic), (module.profile.get_distortion(), ob.OBCameraDistortion),
             (module.OBFormat, ob.OBFormat), (module.OBSensorType, ob.OBSensorType))
    for made, real in pairs:
        assert [name for name in vars(made) if not hasattr(real, name)] == [], real
    assert hasattr(ob.FrameSet, "get_depth_frame") and issubclass(ob.OBError, Exception)
