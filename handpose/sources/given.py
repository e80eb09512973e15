"""What is known of a recording's camera beside its frames: by the file itself, by a camera.json, by the user."""

from __future__ import annotations

from dataclasses import dataclass, replace

from handpose.facts.cameras import Camera
from handpose.sources.lens import Lens


@dataclass(frozen=True)
class Given:
    """None is not known. A camera whose width and height are 0 takes frames of any size.

    camera   of the frames
    lens     its distortion
    unit_mm  what a stored value of 1 stands for
    rate     frames per second
    origin   of these numbers, for messages: "--camera", "camera.json"
    """

    camera: Camera | None = None
    lens: Lens | None = None
    unit_mm: float | None = None
    rate: float | None = None
    origin: str = ""

    def else_by(self, other: Given) -> Given:
        """These numbers, and those of another where these are not known."""
        unknown = {name: value for name, value in vars(other).items() if getattr(self, name) in (None, "")}
        if self.camera is not None:  # a camera's lens is that of the one who names the camera
            unknown.pop("lens", None)
        return replace(self, **unknown)


NOTHING = Given()
