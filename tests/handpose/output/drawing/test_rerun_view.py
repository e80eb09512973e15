"""handpose/output/drawing/rerun_view.py"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.body.render import Capsules
from handpose.output.drawing import hands
from handpose.output.drawing.rerun_view import RerunView, capsules_in_rerun
from handpose.tracking.track import LostHand, TrackedFrame
from netlib.errors import DataError, NetlibError
from tests.support.tracked_hands import CAMERA, HEADER, seen, tracked

RIGHT, LEFT = tracked("right", (-75, 0, 600), 1), tracked("left", (75, 0, 640), 2)
DEPTH = seen([RIGHT, LEFT])
BOTH = TrackedFrame(0, 0.0, (RIGHT, LEFT))
ONE = TrackedFrame(1, 0.1, (RIGHT,), (LostHand(2, "left", 0.0, "left the image"),))


class FakeStream:
    """Records everything that is logged to it."""

    def __init__(self, name: str) -> None:
        self.logged: list[tuple[str, Any]] = []
        self.times: dict[str, Any] = {}
        self.spawned, self.path, self.ended = False, "", ""

    def spawn(self) -> None:
        self.spawned = True

    def save(self, path: str) -> None:
        self.path = path

    def send_blueprint(self, layout: Any) -> None:
        assert layout.kind == "Blueprint"

    def set_time(self, name: str, **time: float) -> None:
        self.times[name] = time

    def log(self, entity: str, what: Any, *, static: bool = False) -> None:
        self.logged.append((entity, what))

    def flush(self) -> None:
        self.ended += "flush "

    def disconnect(self) -> None:
        self.ended += "disconnect"
        if self.path:
            Path(self.path).write_bytes(b"RRF2")

    def last(self, entity: str) -> Any:
        return [what for name, what in self.logged if name == entity][-1]


def archetype(name: str) -> Callable[..., SimpleNamespace]:
    return lambda *given, **named: SimpleNamespace(kind=name, given=given, **named)


@pytest.fixture
def streams(monkeypatch: pytest.MonkeyPatch) -> list[FakeStream]:
    """The opened streams of a fake ``rerun`` module, which has only the names that are used."""
    made: list[FakeStream] = []
    fake = ModuleType("rerun")
    for name in ("Pinhole", "DepthImage", "Points3D", "LineStrips3D", "Capsules3D", "Scalars", "SeriesLines", "TextLog",
                 "Clear"):
        setattr(fake, name, archetype(name))
    views = ("Spatial3DView", "Spatial2DView", "TimeSeriesView", "TextLogView", "ScalarAxis", "Horizontal", "Vertical",
             "Blueprint")
    fake.blueprint = SimpleNamespace(**{name: archetype(name) for name in views})  # type: ignore[attr-defined]
    fake.ViewCoordinates = SimpleNamespace(RDF="right, down, forward")  # type: ignore[attr-defined]
    fake.RecordingStream = lambda name: made.append(FakeStream(name)) or made[-1]  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "rerun", fake)
    return made


def test_the_viewer_is_opened(streams: list[FakeStream]) -> None:
    """The viewer is opened and receives the camera, the time and the frame."""
    with RerunView(HEADER) as view:
        view.log(DEPTH, TrackedFrame(7, 0.25, ()))
    (stream,) = streams
    assert stream.spawned and stream.ended == "flush disconnect"
    assert stream.times == {"time": {"duration": 0.25}, "frame": {"sequence": 7}}
    depth = stream.last("world/camera/depth")
    assert depth.meter == 1000.0 and depth.given[0].dtype == np.uint16
    np.testing.assert_allclose(depth.given[0], DEPTH, atol=0.5)


def test_joints_are_where_rerun_sees_them(streams: list[FakeStream]) -> None:
    """Rerun's pinhole (x right, y down, z forward) puts each joint on its pixel of our camera, without mirroring."""
    with RerunView(HEADER) as view:
        view.log(DEPTH, BOTH)
    pinhole = streams[0].last("world/camera")
    assert pinhole.camera_xyz == streams[0].last("world") == "right, down, forward"
    for hand in (RIGHT, LEFT):
        x, y, z = np.asarray(streams[0].last(f"world/hands/{hand.id}/joints").given[0]).T
        pixels = np.stack([x, y]) / z * np.reshape(pinhole.focal_length, (2, 1))
        pixels += np.reshape(pinhole.principal_point, (2, 1)) - 0.5  # the middle of a pixel of Rerun is at one half
        np.testing.assert_allclose(pixels.T, CAMERA.project(hand.xyz)[:, :2])
        np.testing.assert_allclose(z, hand.xyz[:, 2] / 1000)


def test_bones_in_the_colours_of_fingers(streams: list[FakeStream]) -> None:
    """Bones connect joints and have the colours of their fingers, in the order red, green, blue."""
    with RerunView(HEADER) as view:
        view.log(DEPTH, BOTH)
    joints, bones = (streams[0].last(f"world/hands/1/{part}") for part in ("joints", "bones"))
    tip = HEADER.skeleton.joint_names.index("thumb_tip")
    assert joints.colors[tip] == hands.COLOURS["thumb"][::-1]
    strip, colour = next(
        (s, c) for s, c in zip(bones.given[0], bones.colors) if np.array_equal(s[1], joints.given[0][tip])
    )
    assert colour == hands.COLOURS["thumb"][::-1]
    np.testing.assert_array_equal(strip[0], joints.given[0][HEADER.skeleton.parents[tip]])


def test_a_lost_hand_is_taken_away_and_told_of_once(streams: list[FakeStream]) -> None:
    """A lost hand is removed, its curve ends, and the reason is logged once."""
    with RerunView(HEADER) as view:
        view.log(DEPTH, BOTH)
        view.log(DEPTH, ONE)
        view.log(DEPTH, ONE._replace(number=2, time=0.2))
    logged = streams[0].logged
    assert [what.given for name, what in logged if name == "lost"] == [("left hand 2 lost: left the image",)]
    assert [name for name, what in logged if getattr(what, "kind", "") == "Clear"] == ["world/hands/2", "confidence/2"]
    assert streams[0].last("confidence/1").given == (0.93,)


def test_a_file_is_whole_or_not_there(streams: list[FakeStream], tmp_path: Path) -> None:
    """Until the block ends the file has another name; Ctrl-C ends the block as well."""
    path = tmp_path / "a.rrd"
    with pytest.raises(KeyboardInterrupt), RerunView(HEADER, path) as view:
        view.log(DEPTH, BOTH)
        assert not path.exists()
        raise KeyboardInterrupt
    assert not streams[0].spawned and path.read_bytes() == b"RRF2" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("along", [(1, 2, 3), (0, 0, 1), (0, 0, -1), (-3, 0, -0.1), (0, 0, 0)])
def test_capsules(along: tuple[float, float, float]) -> None:
    """The z axis, turned by the quaternion, ends at the capsule's other end."""
    a, b = np.array([[[10.0, 20, 700]]]), np.array([[[10.0, 20, 700]]]) + along
    lengths, radii, starts, turns = capsules_in_rerun(Capsules(a, b, np.array([[8.0]]), np.array([[6.0]])))
    x, y, z, w = turns[0]
    end = starts[0] + lengths[0] * np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    np.testing.assert_allclose(end, b[0, 0] * (0.001, -0.001, 0.001), atol=1e-9)
    np.testing.assert_allclose([radii[0], np.linalg.norm(turns)], [0.007, 1])


def test_mistakes(streams: list[FakeStream], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another suffix, another image size, a viewer that does not start and a missing rerun raise errors."""
    with pytest.raises(NetlibError, match=r"a\.bin: a recording for Rerun is written as \.rrd"):
        RerunView(HEADER, tmp_path / "a.bin")
    with (
        RerunView(HEADER) as view,
        pytest.raises(DataError, match=r"of shape \(480, 640\), expected \(120, 160\)"),
    ):
        view.log(np.zeros((480, 640), np.float32), BOTH)

    def spawn(stream: FakeStream) -> None:
        raise RuntimeError("no display")

    monkeypatch.setattr(FakeStream, "spawn", spawn)
    with pytest.raises(NetlibError, match=r"^Rerun's viewer does not start: no display; write a file instead"):
        RerunView(HEADER).__enter__()
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(NetlibError, match=r"^rerun-sdk is missing: pip install rerun-sdk$"):
        RerunView(HEADER)


def test_the_real_rerun_takes_it_all(tmp_path: Path) -> None:
    """In strict mode the real Rerun raises an error for anything that it would otherwise only warn about."""
    rerun = pytest.importorskip("rerun", reason="needs rerun-sdk")
    rerun.set_strict_mode(True)
    try:
        with RerunView(HEADER, tmp_path / "a.rrd") as view:
            for frame in (BOTH, ONE):
                view.log(DEPTH, frame)
    finally:
        rerun.set_strict_mode(False)
    content = (tmp_path / "a.rrd").read_bytes()
    assert content.startswith(b"RRF") and len(content) > 10_000
