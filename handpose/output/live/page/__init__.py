"""The page of a live track: one HTML file, which receives its frames from its server.

Its JavaScript, HTML and CSS are in this folder; it also uses those of the hand page
(``handpose.output.hand_page``).
"""

from __future__ import annotations

import functools
from pathlib import Path

from handpose.output.drawing.view import ID_COLOURS
from handpose.output.hand_page.assembly import assembled, script_of, source
from handpose.output.hand_page.values import skeleton_values
from handpose.output.live.messages import VIEWS_PATH
from handpose.tracking.track import TrackHeader

LIVE_FOLDER = Path(__file__).parent


def page(header: TrackHeader) -> str:
    """The page as HTML.

    Its title is the name of the source without its folder, because others may see the page.
    """
    data = {
        "stream": VIEWS_PATH.removeprefix("/"),
        "camera": vars(header.camera),
        "skeleton": skeleton_values(header.skeleton),
        "colours": [colour[::-1] for colour in ID_COLOURS],
    }
    style = source("page.css") + source("live.css", LIVE_FOLDER)
    body = source("live.html", LIVE_FOLDER)
    title = f"{Path(header.source).name}, tracked"
    return assembled(title, data, body, style, script_of("live", LIVE_FOLDER), connects=True)


@functools.cache
def page_without_token() -> str:
    """The answer to a request without a token: a tab that had one continues with it, any other
    shows the error.
    """
    words = "<p>Wrong token. Open the address that the tracker has printed.</p>\n"
    return assembled("Wrong token", {}, words, "", script_of("without_token", LIVE_FOLDER))
