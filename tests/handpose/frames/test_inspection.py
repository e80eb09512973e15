"""handpose/frames/inspection.py: figures of a recording, and each warning."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats.folder import open_folder
from handpose.frames.inspection import inspect, nearest_thing, warnings_of
from handpose.frames.recording import CameraInfo, DepthFrame, Recording
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, hand_sized, put


class Taken(Recording):
    """A recording of given images."""

    def __init__(
        self, images: Sequence[np.ndarray], camera: Camera = CAMERA, unit_mm: float = 1.0, step: float = 1 / 30
    ) -> None:
        self.step = step
        self.name, self.images, self.camera, self.unit_mm, self.count = "take", images, camera, unit_mm, len(images)
        self.remarks = ("a remark",)

    def __iter__(self) -> Iterator[DepthFrame]:
        for i, image in enumerate(self.images):
            yield DepthFrame(i, i * self.step, image.astype(np.float32))


def moving(factor: float = 1.0) -> list[np.ndarray]:
    """Images of an object 500 mm away and 100 mm wide, if the factor is right."""
    return [hand_sized(distance=500 + i) * float(factor) for i in range(3)]


@pytest.mark.parametrize("step", [33.3, 1e-9])
def test_times_that_are_no_seconds(step: float) -> None:
    """Steps in milliseconds or of hours give a warning."""
    (warning,) = inspect(Taken(moving(), step=step)).warnings
    assert warning == f"a frame comes every {step:g} s; check its times, which are seconds, or --rate"


def test_times_by_their_steps(tmp_path: Path) -> None:
    """For names in microseconds the inferred unit is shown, and the times match the usual rates."""
    for number, image in zip((790154000, 790187333, 790220667), moving()):
        put(tmp_path / f"{number}_depth.png", image.astype(np.uint16))
    found = inspect(open_folder(tmp_path, CameraInfo(CAMERA, unit_mm=1.0, rate=30.0)))
    assert [frame.time for frame in found.frames] == pytest.approx([0, 0.033333, 0.066667])
    assert "times from the file names, in us by their steps: a frame every 33.3 ms" in found.remarks
    assert not found.warnings


def test_a_rate_that_is_not_that_of_the_times() -> None:
    """A given rate that contradicts the frames' times gives a warning."""
    taken = Taken(moving(), step=1 / 30)
    taken.rate = 60.0
    (warning,) = inspect(taken).warnings
    assert warning == "60 frames per second given, but 30 by their times; the times are used"
    taken.rate = 28.0
    assert not inspect(taken).warnings


def test_what_is_seen() -> None:
    """Size, depth, zeros and field of view are reported, without warnings for a valid recording."""
    images = moving()
    images[0][:24] = 0
    found = inspect(Taken(images))
    assert (found.name, found.count, found.camera, found.unit_mm) == ("take", 3, CAMERA, 1)
    assert found.depth_mm == (501, 1002, 1004)
    assert found.zeros == pytest.approx(1 / 6)
    assert found.view == pytest.approx((56.1, 42.9), abs=0.1)
    assert found.nearest == pytest.approx((500, 100), rel=0.01)
    assert (found.remarks, found.warnings, len(found.frames)) == (("a remark",), (), 3)


def test_only_the_first_frames_are_read() -> None:
    """Only the requested number of frames is read."""
    assert len(inspect(Taken(moving()), frames=2).frames) == 2


def test_no_frames() -> None:
    """A recording without frames raises an error."""
    with pytest.raises(DataError, match="take: no frame in it"):
        inspect(Taken([]))


@pytest.mark.parametrize("factor", [0.001, 1.0, 30.0])
def test_the_nearest_thing_does_not_depend_on_the_unit(factor: float) -> None:
    """Distance and width scale with the unit; specks in front and the wall behind are ignored."""
    image = hand_sized(distance=500).astype(np.float32)
    image[3, 3] = 200
    assert nearest_thing(image * np.float32(factor), CAMERA) == pytest.approx((500 * factor, 100 * factor), rel=0.01)
    assert nearest_thing(np.zeros((48, 64), np.float32), CAMERA) is None


@pytest.mark.parametrize(
    ("factor", "unit_mm", "advice"),
    [(8, 1.0, "4 m away and 800 mm wide.*with --unit 0.125 it would be 0.50 m away; check the unit, here 1 mm"),
     (0.1, 0.1, "50 mm away and 10 mm wide.*with --unit 1 it would be 0.50 m away; check the unit, here 0.1 mm"),
     (0.001, 1.0, "0.5 mm away and 0.1 mm wide.*with --unit 1000 it would be 0.50 m"),
     (80, 1.0, "40 m away and 8 m wide, which is not plausible for a hand: check the unit")],
)  # fmt: skip
def test_a_unit_that_is_likely_wrong(factor: float, unit_mm: float, advice: str) -> None:
    """An implausible distance or width gives a warning, with a unit of known cameras that would be plausible."""
    (warning,) = inspect(Taken(moving(factor), unit_mm=unit_mm)).warnings
    assert re.search(advice, warning)


@pytest.mark.parametrize(
    ("camera", "what"),
    [
        (replace(CAMERA, fx=400.0, fy=400.0), "400, 400 px give a field of view of 9 x 7 degrees in 64 x 48 pixels"),
        (replace(CAMERA, fx=9.0, fy=9.0), "degrees in 64 x 48 pixels; check fx and fy"),
        (replace(CAMERA, u0=319.5, v0=239.5), "the principal point 319.5, 239.5 is outside of 64 x 48 pixels"),
        (replace(CAMERA, u0=12.0), "the principal point 12, 23.5 is far from the centre of 64 x 48 pixels"),
    ],
)
def test_a_camera_of_another_picture(camera: Camera, what: str) -> None:
    """Camera parameters for another image size give a warning."""
    assert what in " ".join(inspect(Taken(moving(), camera)).warnings)


def test_warnings_of_a_single_frame() -> None:
    """A single frame gets the same warnings about camera and unit as a recording."""
    (image, *_), wrong = moving(0.001), replace(CAMERA, fx=9.0, fy=9.0)
    assert warnings_of(moving()[0].astype(np.float32), CAMERA, 1.0) == []
    camera, unit = warnings_of(image.astype(np.float32), wrong, 1.0)
    assert "check fx and fy" in camera and "check the unit, here 1 mm" in unit
    assert warnings_of(image.astype(np.float32), wrong, 1.0, unit_is_known=True) == [camera]
    assert len(warnings_of(np.zeros((48, 64), np.float32), wrong, 1.0)) == 1


def test_readings_nearer_than_the_camera_measures() -> None:
    """A warning names the share of readings that count as missing."""
    images = moving()
    for image in images:
        image[:2] = 90
    (warning,) = inspect(Taken(images)).warnings
    assert "nearer than 200 mm" in warning
    assert "min_range_mm" in warning
    nearer = inspect(Taken(images, replace(CAMERA, min_range_mm=50.0)))
    assert not any("min_range_mm" in warning for warning in nearer.warnings)


def test_nothing_was_read() -> None:
    """Images of zeros give a warning."""
    found = inspect(Taken([np.zeros((48, 64))] * 3))
    assert (found.depth_mm, found.nearest, found.zeros) == (None, None, 1)
    assert "every depth is 0" in found.warnings[0]


def test_frames_that_do_not_change() -> None:
    """Identical frames give a warning, because a real camera has noise."""
    assert (
        "the first 3 frames are the same to the last value"
        in inspect(Taken([hand_sized(distance=500)] * 3)).warnings[0]
    )
    assert inspect(Taken([hand_sized(distance=500)] * 2)).warnings == ()
