"""The known parameters of a recording's camera, from the user, the file itself, or a camera.json."""

from __future__ import annotations

from dataclasses import dataclass, replace

from handpose.facts.cameras import Camera
from handpose.sources.lens import Lens


@dataclass(frozen=True)
class Given:
    """Camera parameters; None is unknown. A camera whose width and height are 0 accepts frames of any size.

    camera   of the frames
    lens     its distortion
    unit_mm  depth of a stored value of 1
    rate     frames per second
    origin   of these values, for messages: "--camera", "camera.json"
    """

    camera: Camera | None = None
    lens: Lens | None = None
    unit_mm: float | None = None
    rate: float | None = None
    origin: str = ""

    def else_by(self, other: Given) -> Given:
        """These parameters; those of ``other`` where these are unknown."""
        unknown = {name: value for name, value in vars(other).items() if getattr(self, name) in (None, "")}
        if self.camera is not None:  # camera and lens come from the same origin
            unknown.pop("lens", None)
        return replace(self, **unknown)


NOTHING = Given()
