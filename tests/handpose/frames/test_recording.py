"""handpose/frames/recording.py: where camera parameters come from, and which source takes precedence."""

from __future__ import annotations

from handpose.frames.cameras import KINECT2, NYU
from handpose.frames.lens import Lens
from handpose.frames.recording import UNKNOWN, CameraInfo

LENS = Lens((0.1, 0, 0, 0))


def test_what_is_not_known_is_filled_in() -> None:
    assert CameraInfo(NYU, unit_mm=0.5).or_else(CameraInfo(KINECT2, None, 1.0, 30.0, "a file")) == CameraInfo(
        NYU, None, 0.5, 30.0, "a file"
    )
    assert UNKNOWN.or_else(CameraInfo(NYU, LENS, 1.0, 30.0, "a file")) == CameraInfo(NYU, LENS, 1.0, 30.0, "a file")
    assert CameraInfo(NYU).or_else(UNKNOWN) == CameraInfo(NYU)


def test_a_lens_belongs_to_its_camera() -> None:
    """Another camera does not get the first one's lens; a lens alone applies to any camera."""
    assert CameraInfo(NYU).or_else(CameraInfo(KINECT2, LENS)).lens is None
    assert CameraInfo(lens=LENS).or_else(CameraInfo(KINECT2)) == CameraInfo(KINECT2, LENS)
