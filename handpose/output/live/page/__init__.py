"""The page of a live track: one HTML file, which receives its frames from its server.

Its JavaScript, HTML and CSS are in this folder; it also uses those of the hand page
(``handpose.output.hand_page``).
"""

from __future__ import annotations

import functools
from pathlib import Path

from handpose.output.drawing.view import COLOURS
from handpose.output.hand_page.assembly import assembled, script_of, skeleton_values, source
from handpose.output.live.messages import VIEWS
from handpose.tracking.track import TrackHeader

FOLDER = Path(__file__).parent


def page(header: TrackHeader) -> str:
    """The page as HTML.

    Its title is the name of the source without its folder, because others may see the page.
    """
    data = {
        "stream": VIEWS.removeprefix("/"),
        "camera": vars(header.camera),
        "skeleton": skeleton_values(header.skeleton),
        "colours": [colour[::-1] for colour in COLOURS],
    }
    style, body = source("page.css") + source("live.css", FOLDER), source("live.html", FOLDER)
    title = f"{Path(header.source).name}, tracked"
    return assembled(title, data, body, style, script_of("live", FOLDER), connects=True)


@functools.cache
def page_without_token() -> str:
    """The answer to a request without a token: a tab that had one continues with it, any other
    shows the error.
    """
    words = "<p>Wrong token. Open the address that the tracker has printed.</p>\n"
    return assembled("Wrong token", {}, words, "", script_of("without_token", FOLDER))
