"""Pictures of pages in docs/images, and the frames of docs/book/nano.py.

Run by hand; the pages need a Chromium.

python -m docs.making.pictures hand_page     the page docs/hand.html, with a pose and a force
python -m docs.making.pictures live_page     the page of tools/track.py --serve, with a
                                             synthetic recording
python -m docs.making.pictures frames        docs/book/frames.npz: the first rendered
                                             training frames

Others are written by a command: demo.png is demo/hands.png of ``tools/demo.py --out demo
--seed 1 --frames 2``; synthetic.png is from ``tools/make_synthetic.py --out
data --train 64 --test 480 --workers 1``, then ``tools/show_data.py data/test.txt --frames 24
--plain --out synthetic.png``.
"""

from __future__ import annotations

import itertools
import re
import shutil
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from netlib.files import atomic
from netlib.files.paths import ROOT

if TYPE_CHECKING:
    from playwright.sync_api import Browser

SIZE: Any = {"width": 1280, "height": 800}  # playwright has a type for it, if installed
POSE = """async () => {
  const { body, data, view } = hand, { dofs, joints } = body.skeleton;
  const pose = Object.entries({ ...data.bodies[0].poses.point, palm_rot_y: 0.5 });
  body.setInputs(Object.fromEntries(pose.map(([name, value]) => [dofs.indexOf(name), value])));
  body.applyForce(joints.indexOf("index_tip"), [13, 4, -9]);
  view.camera.rotate(-20, 10);
  await new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)));
  view.draw(2); // in high resolution
}"""


def hand_page(browser: Browser) -> bytes:
    """The page of the hand as PNG."""
    from docs.making import pages

    with browser.new_page(viewport=SIZE, color_scheme="light") as tab:
        tab.set_content(pages.hand())
        tab.evaluate(POSE)
        return tab.screenshot()


def live_page(browser: Browser) -> bytes:
    """The live page as PNG, after 90 frames of two hands."""
    from handpose import NYU, load_tracker
    from handpose.body.gestures import GestureReader
    from handpose.output.live.messages import VIEWS_PATH, Messages
    from handpose.output.live.page import page
    from handpose.output.live.server import LiveServer
    from handpose.sequences.recordings import SyntheticRecording

    tracker = load_tracker(NYU)
    header = tracker.header("takes/both")
    messages, reader = Messages(header), GestureReader(header.skeleton)
    recording = itertools.islice(SyntheticRecording("two_hands", NYU), 90)
    tracked = [(frame.depth, tracker.step(frame).with_gestures(reader)) for frame in recording]
    with (
        LiveServer("127.0.0.1", 0, messages.header, page(header)) as server,
        browser.new_page(viewport=SIZE, color_scheme="light") as tab,
    ):
        tab.goto(server.page_url)
        for depth, found in tracked:
            server.put(VIEWS_PATH, messages.view(messages.record(found), depth, found))
            shown = re.compile(rf"^frame {found.number}, ")
            tab.locator("#state").filter(has_text=shown).wait_for()
        tab.evaluate("live.view.camera.rotate(-40, 15), live.view.draw(2)")
        return tab.screenshot()


def write_frames() -> None:
    """Write depth (64, 1, 128, 128) in 1/127 of a half-cube, joints (64, 31, 3) in half-cubes."""
    from docs.making.figures.whole import rendered

    frames = rendered("train", 64)
    depth = np.rint(frames.depth * 127).astype(np.int8)
    joints = frames.joints.astype(np.float32)
    np.savez_compressed(ROOT / "docs" / "book" / "frames.npz", depth=depth, joints=joints)


def write_picture(name: str) -> None:
    """Write the picture of a page to docs/images."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        picture = {"hand_page": hand_page, "live_page": live_page}[name](browser)
    atomic.replace_bytes(ROOT / "docs" / "images" / f"{name}.png", picture)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        if name == "frames":
            write_frames()
        else:
            write_picture(name)
