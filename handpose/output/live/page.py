"""The page of a live track: one file for one track, which receives its frames from its server."""

from __future__ import annotations

import functools

from handpose.body.model import Surface
from handpose.output.drawing import labels
from handpose.output.drawing.page.assembly import assembled, script_of, source
from handpose.output.live.messages import VIEWS
from handpose.tracking.track import TrackHeader
from netlib.files.paths import own

BROWSER = own("web/live")
COLOURS = 6  # number of colours of hands; then they repeat


def page(header: TrackHeader) -> str:
    """The page as HTML."""
    surface, camera = Surface(header.skeleton), header.camera
    data = {
        "stream": VIEWS.removeprefix("/"), "camera": vars(camera),
        "skeleton": {"joints": header.skeleton.joint_names, "parents": header.skeleton.parents.tolist()},
        "whole": surface.whole.joint_names, "capsules": [[int(a), int(b)] for a, b in zip(surface.start, surface.end)],
        "colours": [labels.colour_of(id)[::-1] for id in range(COLOURS)],
    }
    style = source("page.css") + source("live.css", BROWSER)
    body = source("live.html", BROWSER)
    return assembled(f"{header.source}, live", data, body, style, script_of("live", BROWSER), connects=True)


@functools.cache
def page_without_token() -> str:
    """The answer to a request without a token: a tab that had one continues with it, any other shows the error."""
    return assembled("Wrong token", {}, source("without_token.html", BROWSER), "", script_of("without_token", BROWSER))
