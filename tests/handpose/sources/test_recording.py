"""handpose/sources/recording.py: where camera parameters come from, and which source takes precedence."""

from __future__ import annotations

from handpose.facts.cameras import KINECT2, NYU
from handpose.sources.lens import Lens
from handpose.sources.recording import NOTHING, Given

LENS = Lens((0.1, 0, 0, 0))


def test_what_is_not_known_is_filled_in() -> None:
    """And nothing else."""
    assert Given(NYU, unit_mm=0.5).else_by(Given(KINECT2, None, 1.0, 30.0, "a file")) == Given(
        NYU, None, 0.5, 30.0, "a file"
    )
    assert NOTHING.else_by(Given(NYU, LENS, 1.0, 30.0, "a file")) == Given(NYU, LENS, 1.0, 30.0, "a file")
    assert Given(NYU).else_by(NOTHING) == Given(NYU)


def test_a_lens_belongs_to_its_camera() -> None:
    """Whoever names another camera does not get the lens of the first; a lens alone is for whatever camera."""
    assert Given(NYU).else_by(Given(KINECT2, LENS)).lens is None
    assert Given(lens=LENS).else_by(Given(KINECT2)) == Given(KINECT2, LENS)
