"""docs/images/hand_page.png: the page docs/hand.html as one sees it, with a pose and a force. Needs a Chromium.

python -m docs.making.hand_picture
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from docs.making import chromium, hand_page
from netlib.files.paths import ROOT

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PICTURE = ROOT / "docs" / "images" / "hand_page.png"
SIZE: Any = {"width": 1280, "height": 800}  # playwright has a type for it, if installed
SHOWN = """async () => {
  const { body, data, view } = hand, { dofs, joints } = body.skeleton;
  const pose = Object.entries({ ...data.bodies[0].poses.point, palm_rot_y: 0.5 });
  body.setInputs(Object.fromEntries(pose.map(([name, value]) => [dofs.indexOf(name), value])));
  body.applyForce(joints.indexOf("index_tip"), [13, 4, -9]);
  view.camera.rotate(-20, 10);
  await new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)));
  view.draw(2); // in high resolution
}"""


def taken(browser: Browser) -> bytes:
    """The picture as PNG."""
    (made,) = hand_page.made()
    with browser.new_page(viewport=SIZE, color_scheme="light") as tab:
        tab.set_content(made.make().decode())
        tab.evaluate(SHOWN)
        return tab.screenshot()


def main() -> int:
    """Write the picture; returns the exit status."""
    return chromium.write(PICTURE, taken)


if __name__ == "__main__":
    sys.exit(main())
