"""handpose/frames/inspection.py: figures of a recording, and each warning."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.inspection import checked, inspect, nearest_thing, view_of
from handpose.frames.recording import DepthFrame, Recording
from tests.handpose.frames.conftest import CAMERA, hand_sized


class Taken(Recording):
    """A recording of given images."""

    def __init__(
        self,
        images: Sequence[np.ndarray],
        camera: Camera = CAMERA,
        unit_mm: float = 1.0,
        step: float = 1 / 30,
    ) -> None:
        self.name = "take"
        self.images = images
        self.camera = camera
        self.unit_mm = unit_mm
        self.count = len(images)
        self.step = step
        self.remarks = ("a remark",)

    def __iter__(self) -> Iterator[DepthFrame]:
        for i, image in enumerate(self.images):
            yield DepthFrame(i, i * self.step, image.astype(np.float32))


def moving(factor: float = 1.0) -> list[np.ndarray]:
    """Images of an object 500 mm away and 100 mm wide, if the factor is right."""
    return [hand_sized(distance=500 + i) * float(factor) for i in range(3)]


def moving_stored() -> list[np.ndarray]:
    """The same in values of 16 bits."""
    return [image.astype(np.uint16) for image in moving()]


def test_a_valid_recording_is_described_without_warnings() -> None:
    """Size, depth, zeros and field of view are reported."""
    images = moving()
    images[0][:24] = 0
    found = inspect(Taken(images))
    assert found.depth_mm == (501, 1002, 1004)
    assert found.zeros == pytest.approx(1 / 6)
    assert view_of(CAMERA) == pytest.approx((56.1, 42.9), abs=0.1)
    assert found.nearest == pytest.approx((500, 100), rel=0.01)
    assert (found.remarks, found.warnings, len(found.frames)) == (("a remark",), (), 3)


def test_every_frame_is_read_once() -> None:
    """The frames that were inspected are not read again; those of a camera are not kept."""
    taken = Taken(moving() * 4)
    seen = inspect(taken)
    assert len(seen.frames) == 10
    assert [frame.number for frame in seen.all_frames()] == list(range(12))
    taken.live = True
    seen = inspect(taken)
    assert [frame.number for frame in seen.all_frames()] == list(range(12))
    assert list(seen.rest) == []


@pytest.mark.parametrize("factor", [0.001, 1.0, 30.0])
def test_the_nearest_thing_does_not_depend_on_the_unit(factor: float) -> None:
    image = hand_sized(distance=500).astype(np.float32)
    image[3, 3] = 200
    found = nearest_thing(image * np.float32(factor), CAMERA)
    assert found == pytest.approx((500 * factor, 100 * factor), rel=0.01)
    assert nearest_thing(np.zeros((48, 64), np.float32), CAMERA) is None


@pytest.mark.parametrize(
    ("factor", "unit_mm", "advice"),
    [
        (8, 1.0, "4 m away and 800 mm wide.*with --unit 0.125 0.50 m away and 100 mm wide"),
        (
            4,
            1.0,
            "2 m away and 400 mm wide.*with --unit 0.25 0.50 m away and 100 mm wide.*check the unit, here 1 mm",
        ),
        (5, 1.0, "2.5 m away and 500 mm wide.*with --unit 0.2 0.50 m away and 100 mm wide"),
        (10, 1.0, "5 m away and 1 m wide.*with --unit 0.1 0.50 m away and 100 mm wide"),
        (1, 0.25, "^$"),
        (0.1, 0.1, "50 mm away and 10 mm wide.*with --unit 1 0.50 m away"),
        (0.001, 1.0, "0.5 mm away and 0.1 mm wide.*with --unit 1000 0.50 m"),
        (80, 1.0, "40 m away and 8 m wide, which is not plausible for a hand: check the unit"),
    ],
)
def test_a_unit_that_is_likely_wrong(factor: float, unit_mm: float, advice: str) -> None:
    warnings = inspect(Taken(moving(factor), unit_mm=unit_mm)).warnings
    assert len(warnings) == (advice != "^$")
    assert re.search(advice, "".join(warnings).replace("it would be ", ""))


@pytest.mark.parametrize(
    ("step", "rate", "warning"),
    [
        (33.3, None, "a frame every 33.3 s, which is not plausible; check the times"),
        (0.0000333, 30.0, "a frame every 3.33e-05 s, which is not plausible"),
        (1 / 30, 5.0, "a frame every 0.0333 s by the times, which are used, and not 5 frames/s"),
        (1 / 15, 30.0, None),
        (1 / 5, None, None),
        (1 / 300, None, None),
    ],
)
def test_times_that_are_likely_wrong(step: float, rate: float | None, warning: str | None) -> None:
    """Of another unit, or of another rate than the one that is given."""
    taken = Taken(moving(), step=step)
    taken.rate = rate
    found = inspect(taken).warnings
    assert [one[: len(warning or "")] for one in found] == ([warning] if warning else [])


@pytest.mark.parametrize("unit_mm", [1.0, 0.1])
def test_disparities_of_a_kinect(unit_mm: float) -> None:
    """As NYU Depth v2 and libfreenect's fakenect store them."""
    images = moving()
    for image in images:
        image[:, :8] = 2047
    (warning,) = inspect(Taken([image * unit_mm for image in images], unit_mm=unit_mm)).warnings
    assert warning.startswith("no value is more than 2047, which many pixels have")
    images[0][:, 8] = 2048
    assert not any("2047" in one for one in inspect(Taken(images)).warnings)


@pytest.mark.parametrize("unit_mm", [1.0, 0.125])
def test_values_of_the_other_byte_order(rng: np.random.Generator, unit_mm: float) -> None:
    """Their distances are plausible, but neighbours differ by 100s of mm."""
    images = [image + rng.integers(0, 4, image.shape, np.uint16) for image in moving_stored()]
    right, swapped = (
        inspect(Taken([one * np.float32(unit_mm) for one in stored], unit_mm=unit_mm)).warnings
        for stored in (images, [image.byteswap() for image in images])
    )
    assert not any("byte order" in one for one in right)
    assert [one for one in swapped if "these are likely depths of the other byte order" in one]


@pytest.mark.parametrize("true_mm", [0.25, 0.2])
@pytest.mark.parametrize("distance", [300, 450, 600, 900])
def test_a_unit_for_any_distance(true_mm: float, distance: int) -> None:
    """Depth in units of 0.25 and 0.2 mm is doubted for a hand at any usual distance; the right
    unit is suggested.

    For a hand so near that it may be another one farther away, the doubt appears if no
    hand is found.
    """
    images = [hand_sized(distance=distance + i) / true_mm for i in range(3)]
    found = inspect(Taken(images))
    assert f"--unit {true_mm:g}" in found.doubt
    if distance / true_mm > 1600:
        (warning,) = found.warnings
        assert f"--unit {true_mm:g}" in warning
    right = inspect(Taken([image * true_mm for image in images], unit_mm=true_mm))
    assert (right.warnings, right.doubt) == ((), "")


def test_a_wide_object_beyond_1_m_gives_a_warning() -> None:
    """It is a person, or a hand of another unit; the hand of a near person is not doubted."""
    assert inspect(Taken([hand_sized(distance=1300)])).warnings == ()
    image = np.full((48, 64), 2800)
    image[:, 16:48] = 1300
    (warning,) = inspect(Taken([image + i for i in range(3)])).warnings
    assert "1.3 m away" in warning
    assert "--unit 0.25 it would be 0.33 m away and 173 mm wide" in warning
    image[18:28, 26:38] = 600
    found = inspect(Taken([image + i for i in range(3)]))
    assert (found.warnings, found.doubt) == ((), "")


@pytest.mark.parametrize(
    ("camera", "what"),
    [
        (
            replace(CAMERA, fx=400.0, fy=400.0),
            "400, 400 px give a field of view of 9 x 7 degrees in 64 x 48 pixels",
        ),
        (replace(CAMERA, fx=9.0, fy=9.0), "degrees in 64 x 48 pixels; check fx and fy"),
        (
            replace(CAMERA, u0=319.5, v0=239.5),
            "the principal point 319.5, 239.5 is outside of 64 x 48 pixels; check u0 and v0, which may be for "
            "another image size, about 10 times as wide: divide all four",
        ),
        (
            replace(CAMERA, u0=12.0),
            "the principal point 12, 23.5 is far from the centre of 64 x 48 pixels",
        ),
        (
            replace(CAMERA, u0=23.5, v0=31.5),
            "the principal point 23.5, 31.5 is that of 48 x 64 pixels, and these are 64 x 48",
        ),
        (  # as 1280 x 720: far from the centre, too
            replace(CAMERA, height=36, u0=17.5, v0=31.5),
            "the principal point 17.5, 31.5 is that of 36 x 64 pixels, and these are 64 x 36",
        ),
    ],
)
def test_a_camera_that_does_not_fit_the_image_gives_a_warning(camera: Camera, what: str) -> None:
    images = [image[: camera.height] for image in moving()]
    assert what in " ".join(inspect(Taken(images, camera)).warnings)


def test_a_single_frame() -> None:
    """The default unit is the camera's."""
    image, wrong = moving(0.001)[0].astype(np.float32), replace(CAMERA, fx=9.0, fy=9.0)
    found = checked([image], wrong)
    assert "check fx and fy" in found.of_camera[0]
    assert "check the unit, here 1 mm" in found.of_depths[0]
    assert (
        "check the unit, here 0.125 mm"
        in checked([image], replace(CAMERA, name="sr305")).of_depths[0]
    )
    assert len(checked([np.zeros((48, 64), np.float32)], wrong).of_camera) == 1


def test_readings_nearer_than_the_camera_measures() -> None:
    images = moving()
    for image in images:
        image[:2] = 90
    (warning,) = inspect(Taken(images)).warnings
    assert "nearer than 200 mm" in warning
    assert "min_range_mm" in warning
    nearer = inspect(Taken(images, replace(CAMERA, min_range_mm=50.0)))
    assert not any("min_range_mm" in warning for warning in nearer.warnings)


def test_a_recording_without_depth_gives_a_warning() -> None:
    found = inspect(Taken([np.zeros((48, 64))] * 3))
    assert (found.depth_mm, found.nearest, found.zeros) == (None, None, 1)
    assert "every depth is 0" in found.warnings[0]
