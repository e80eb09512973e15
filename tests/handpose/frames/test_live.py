"""handpose/frames/live.py: frames of any device, dropped ones, clocks, ends and failures, with and
without a thread.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.lens import Lens, Undistorter
from handpose.frames.live import DeviceFrame, LiveRecording, open_device
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, hand_sized
from tests.support.bad_input import bad_inputs

Event = DeviceFrame | Exception | None
INCOMPLETE = "simulated: expected the camera with its width and height, and unit_mm"


class Simulated:
    """A device that yields the given frames, and raises the given exceptions, in turn."""

    name = "simulated"

    def __init__(self, events: Iterable[Event], info: CameraInfo | None = None) -> None:
        self.info = info or CameraInfo(CAMERA, unit_mm=0.5, rate=10.0)
        self.events = iter(events)
        self.closed = 0

    def read(self) -> DeviceFrame | None:
        event = next(self.events, None)
        if isinstance(event, Exception):
            raise event
        return event

    def close(self) -> None:
        self.closed += 1


def frame(
    time: float, number: int | None = None, value: int = 1000, clock: object = None
) -> DeviceFrame:
    return DeviceFrame(time, hand_sized(distance=value), number, clock)


def test_times_begin_at_0_and_lost_frames_are_counted() -> None:
    """Depth is in mm; a repeated frame is skipped."""
    device = Simulated(
        [frame(5.0, 7), frame(5.1, 8), frame(5.1, 8), None, frame(5.4, 11), EOFError()]
    )
    with LiveRecording(device) as recording:
        assert (recording.camera, recording.unit_mm, recording.rate, recording.live) == (
            CAMERA,
            0.5,
            10,
            True,
        )
        frames = list(recording)
    assert [one.number for one in frames] == [0, 1, 4]
    assert [one.time for one in frames] == pytest.approx([0, 0.1, 0.4])
    assert (frames[0].depth == hand_sized(distance=1000) * np.float32(0.5)).all()
    assert (recording.remarks, recording.cut) == (
        ("frames lost because they were not taken in time: 2",),
        "",
    )
    assert device.closed == 1


@pytest.mark.parametrize(
    "times",
    [
        [(1.0, "a"), (1.1, "a"), (1.7e9, "b"), (1.7e9 + 0.1, "b")],
        [(5.0, "a"), (5.0, "a"), (0.0, "a"), (0.1, "a")],
    ],
)
def test_a_clock_that_changes(times: list[tuple[float, str]]) -> None:
    """Times ascend if the clock changes, stands still or restarts; then one frame's time passes."""
    recording = LiveRecording(
        Simulated([frame(time, clock=clock) for time, clock in times] + [EOFError()])
    )
    assert [one.time for one in recording] == pytest.approx([0, 0.1, 0.2, 0.3], abs=1e-6)


def test_a_clock_that_is_not_in_s() -> None:
    """A device is never silent for so long; frames that were not read count."""
    times = [frame(1000.0, 0), frame(1100.0, 1), frame(1300.0, 3), EOFError()]
    recording = LiveRecording(Simulated(times))
    assert [one.time for one in recording] == pytest.approx([0, 0.1, 0.3])
    assert recording.remarks[-1].endswith("after the frame before, and not used: 2; expected s")
    slow = LiveRecording(Simulated([frame(1.0, 0), frame(61.0, 600), EOFError()]))
    assert [one.time for one in slow] == pytest.approx([0, 60])
    assert "after the frame before" not in slow.remarks[-1]


@pytest.mark.parametrize(
    ("end", "cut"),
    [
        ([None] * 5, "no frame for 5 s; was the camera unplugged?"),
        (
            [TimeoutError("nothing came")] * 5,
            "no frame for 5 s; was the camera unplugged? (nothing came)",
        ),
        ([ValueError("USB error 7")], "the camera has stopped: USB error 7"),
        ([EOFError("the end")], ""),
    ],
)
def test_the_end(end: list[Event], cut: str) -> None:
    """A device that ends, fails or sends nothing more ends the recording, with the reason; frames
    are counted here.
    """
    recording = LiveRecording(Simulated([frame(1.0), frame(1.2), frame(1.9), *end]))
    assert [one.number for one in recording] == [0, 1, 2]
    assert (recording.remarks, recording.cut) == ((), cut)


def test_the_end_in_a_thread() -> None:
    """Exceptions of the thread come after its last frame; a timeout before a frame
    has no effect.
    """
    events: queue.Queue[Event] = queue.Queue()
    with open_device(Simulated(iter(events.get, "never"))) as recording:
        events.put(TimeoutError("not yet"))
        events.put(frame(1.0))
        frames = iter(recording)
        assert next(frames).number == 0
        events.put(ValueError("USB error 7"))
        assert list(frames) == [] and recording.cut == "the camera has stopped: USB error 7"


def test_an_event_that_is_no_frame_ends_the_recording() -> None:
    """The reason names the mistake in the program of the device."""
    with open_device(Simulated([(1.0, hand_sized())])) as recording:  # type: ignore[list-item]
        assert list(recording) == []
    assert recording.cut == "the camera has stopped: 'tuple' object has no attribute 'number'"


def test_a_thread_keeps_the_newest_frame() -> None:
    """While a frame is in use, those that come are read, and all but the newest are
    dropped and counted.
    """
    read = threading.Semaphore(0)
    released = [threading.Event(), threading.Event()]

    def events() -> Iterable[Event]:
        shared = hand_sized()  # an SDK may reuse its memory
        yield DeviceFrame(1.0, shared)
        released[0].wait()
        for i in range(1, 6):
            shared[:] = 100 * i
            yield DeviceFrame(1.0 + i / 10, shared)
        read.release()
        released[1].wait()
        yield EOFError()

    device = Simulated(events())
    with open_device(device) as recording:
        frames = iter(recording)
        first = next(frames)
        released[0].set()
        read.acquire()
        second = next(frames)
        released[1].set()
        assert list(frames) == []
    assert (first.number, second.number, round(second.time, 3)) == (0, 5, 0.5)
    assert (second.depth == 250).all()
    assert (recording.remarks, recording.cut) == (
        ("frames lost because they were not taken in time: 4",),
        "",
    )
    assert device.closed == 1


def test_given_parameters() -> None:
    """The user's parameters replace the device's; its lens is removed."""
    lens = Lens((-0.1, 0.02, 0, 0))
    device = Simulated([frame(0.0), EOFError()], CameraInfo(CAMERA, lens, 1.0))
    (one,) = LiveRecording(device, CameraInfo(unit_mm=0.25))
    expected = Undistorter(CAMERA, lens)(hand_sized().astype(np.float32) / 4)
    np.testing.assert_array_equal(one.depth, expected)


@bad_inputs(
    DataError,
    {
        "no camera": ((CameraInfo(unit_mm=1.0), CameraInfo()), INCOMPLETE),
        "no unit": ((CameraInfo(CAMERA), CameraInfo()), INCOMPLETE),
        "no size": (
            (CameraInfo(Camera("own", 60, 60, 32, 24, 0, 0), unit_mm=1.0), CameraInfo()),
            INCOMPLETE,
        ),
        **{
            f"{name} {value}": (
                (CameraInfo(CAMERA, **{"unit_mm": 1.0, name: value}), CameraInfo()),
                f"simulated: {name} is {value}; expected a number more than 0",
            )
            for name, value in (("unit_mm", 0.0), ("unit_mm", np.nan), ("rate", -30.0))
        },
        "another size": (
            (CameraInfo(CAMERA, unit_mm=1.0), CameraInfo(Camera("x", 60, 60, 32, 24, 99, 48))),
            "simulated: 64 x 48 pixels; camera x has 99 x 48",
        ),
    },
)
def test_parameters_that_do_not_fit(given: tuple[CameraInfo, CameraInfo], rejected: Any) -> None:
    """A device without its parameters, or with others than given, raises an error and is closed."""
    device = Simulated([], given[0])
    with rejected:
        LiveRecording(device, given[1])
    assert device.closed == 1


@bad_inputs(
    DataError,
    {
        "an error made for users": (
            DataError("simulated: not calibrated"),
            "simulated: not calibrated",
        ),
        "a frame of another size": (
            DeviceFrame(0.0, np.zeros((3, 4), np.uint16)),
            "simulated: 4 x 3 pixels; the camera has 64 x 48",
        ),
        "no number for a time": (
            frame(float("nan")),
            "simulated: a frame's time is nan; expected s",
        ),
    },
)
def test_bad_events(given: Event, rejected: Any) -> None:
    with rejected:
        list(LiveRecording(Simulated([given])))
