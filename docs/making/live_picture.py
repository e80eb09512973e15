"""docs/images/live_page.png: the page of tools/track.py --serve, with a synthetic recording. Needs a Chromium.

python -m docs.making.live_picture
"""

from __future__ import annotations

import re
import sys
from typing import TYPE_CHECKING, Any

from docs.making import chromium
from handpose import NYU, load_tracker
from handpose.output.live.messages import VIEWS, Messages
from handpose.output.live.page import page
from handpose.output.live.server import LiveServer
from handpose.sequences.recordings import SyntheticRecording
from netlib.files.paths import ROOT

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PICTURE = ROOT / "docs" / "images" / "live_page.png"
SIZE: Any = {"width": 1280, "height": 800}  # playwright has a type for it, if installed
FRAMES = 90


def taken(browser: Browser, frames: int = FRAMES) -> bytes:
    """The picture as PNG."""
    recording = SyntheticRecording("two_hands", NYU)
    tracker = load_tracker(NYU, surface=True)
    header = tracker.header("takes/both")
    messages = Messages(header, gestures=True)
    tracked = [(frame.depth, tracker.step(frame)) for frame, _ in zip(recording, range(frames))]
    with LiveServer("127.0.0.1", 0, messages.header, page(header)) as server:
        tab = browser.new_page(viewport=SIZE, color_scheme="light")
        tab.goto(server.page_url)
        for depth, found in tracked:
            server.put(VIEWS, messages.view(messages.record(found), depth, found))
            tab.locator("#state").filter(has_text=re.compile(rf"^frame {found.number}, ")).wait_for()
        tab.evaluate("live.view.camera.rotate(-40, 15), live.view.draw(2)")
        try:
            return tab.screenshot()
        finally:
            tab.close()


def main() -> int:
    """Write the picture; returns the exit status."""
    return chromium.write(PICTURE, taken)


if __name__ == "__main__":
    sys.exit(main())
