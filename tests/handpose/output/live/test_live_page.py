"""handpose/output/live/page: the page in Chromium, with frames from a server in this process."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.body.gestures import GestureReader
from handpose.output.drawing.hands import FINGER_COLOURS
from handpose.output.drawing.view import Contrast, ViewportFollower
from handpose.output.live.messages import VIEWS_PATH, Messages
from handpose.output.live.page import page
from handpose.output.live.server import LiveServer
from handpose.tracking.track import TrackedFrame
from tests.handpose.output.live.conftest import BOTH, DEPTH, LEFT, ONE, RIGHT
from tests.support.chromium_tabs import picture
from tests.support.tracked_hands import CAMERA, HEADER, lost

Visit = Callable[..., Any]


class Shown:
    """A server, and a browser tab that shows its page."""

    def __init__(self, server: LiveServer, visit: Visit) -> None:
        self.server = server
        self.messages = Messages(HEADER)
        self.gestures = GestureReader(HEADER.skeleton)
        self.tab = visit(server.page_url, viewport={"width": 1200, "height": 900})
        assert server.wait_for_client(60)

    def put(self, frame: TrackedFrame) -> None:
        frame = frame.with_gestures(self.gestures)
        self.server.put(VIEWS_PATH, self.messages.view(self.messages.record(frame), DEPTH, frame))

    def show(self, frame: TrackedFrame) -> None:
        """Send a frame and wait until it is drawn."""
        self.put(frame)
        self.state(f"frame {frame.number}, {frame.time:.2f} s; ")

    def state(self, begin: str) -> None:
        """Wait until the status line begins with this text."""
        self.tab.locator("#state").filter(has_text=re.compile(f"^{re.escape(begin)}")).wait_for()


@pytest.fixture
def shown(server: LiveServer, visit: Visit) -> Shown:
    """A page without frames so far."""
    return Shown(server, visit)


def test_both_hands_of_a_frame(shown: Shown) -> None:
    """Joints, surfaces, depth and its contrast equal the tracked ones, and the list has each
    hand's confidence.
    """
    shown.state("connected; no frame yet")
    shown.show(BOTH)
    joints = np.array(shown.tab.evaluate("live.scene.joints"))
    assert_allclose(joints, np.concatenate([RIGHT.xyz, LEFT.xyz]), atol=0.01)
    ends = np.array(shown.tab.evaluate("live.scene.capsules.map(({ a, rb }) => [...a, rb])"))
    surfaces = [hand.pose.capsules for hand in (RIGHT, LEFT)]
    expected = [np.c_[surface.a[0], surface.radius_b[0]] for surface in surfaces]
    assert_allclose(ends, np.concatenate(expected), rtol=1e-5)
    points = np.array(shown.tab.evaluate("live.scene.points")).reshape(-1, 3)
    u, v, d = CAMERA.project(points).T
    assert_allclose(d, DEPTH.astype(int)[np.rint(v).astype(int), np.rint(u).astype(int)])
    assert len(points) > 1000
    contrast = Contrast()
    contrast.see(0.0, DEPTH, np.concatenate([RIGHT.xyz, LEFT.xyz])[:, 2])
    assert shown.tab.evaluate("[live.frame.middle, live.frame.spread]") == [
        contrast.middle,
        contrast.spread,
    ]
    assert shown.tab.locator("#hands li").all_inner_texts() == [
        "right 93%, expected error 8 mm, gesture open",
        "left 42%, expected error 8 mm, gesture open",
    ]


def test_the_depth_image(shown: Shown) -> None:
    """Nearer is lighter, and each joint's disc is at its pixel in its finger's colour."""
    shown.show(BOTH)
    image = picture(shown.tab, "depth")
    view = ViewportFollower(CAMERA).see(0.0, [RIGHT, LEFT])
    zoom = image.shape[1] / view.width
    for hand in (RIGHT, LEFT):
        for joint in ("thumb_tip", "little_tip"):
            u, v, _ = CAMERA.project(hand.xyz[HEADER.skeleton.joint_names.index(joint)])
            colour = image[int((v + 0.5 - view.top) * zoom), int((u + 0.5 - view.left) * zoom), :3]
            assert_allclose(colour, FINGER_COLOURS[joint.split("_")[0]][::-1], atol=3)
    wall = int(image[-3, -3, 0])
    u, v, _ = CAMERA.project(RIGHT.xyz.mean(axis=0))
    assert image[int((v + 4 - view.top) * zoom), int((u - view.left) * zoom), 0] > wall + 50
    shown.tab.locator("#depth").hover(position={"x": 1, "y": 1})
    assert (
        shown.tab.locator("#hover").inner_text()
        == f"column {int(view.left)}, row {int(view.top)}: 1500 mm"
    )


def test_a_side_that_is_assumed(shown: Shown) -> None:
    """While the side is undecided, list and tag have the assumed one with a question mark."""
    shown.show(TrackedFrame(0, 0.0, (replace(RIGHT, side_confidence=0.7), lost(2, None))))
    texts = shown.tab.locator("#hands li").all_inner_texts()
    assert texts[0].startswith("right? 93%, ") and texts[1] == "hand lost 0.0 s: hidden"


def test_a_lost_hand_is_listed_for_three_seconds(shown: Shown) -> None:
    shown.show(TrackedFrame(1, 2.9, (lost(2, "left"), lost(3, since=-0.2))))
    assert shown.tab.locator("#hands li").all_inner_texts() == ["left hand lost 2.9 s: hidden"]


def test_the_space(shown: Shown) -> None:
    """Surface, skeleton and points are drawn, and can be switched off."""
    shown.show(BOTH)

    def covered() -> int:
        return int(np.count_nonzero(picture(shown.tab, "view", draw="live.view.draw(1)")[..., 3]))

    every = covered()
    shown.tab.get_by_label("surface").uncheck()
    bones = covered()
    shown.tab.get_by_label("depth points").uncheck()
    shown.tab.get_by_label("skeleton", exact=True).uncheck()
    assert every > bones > 2 * covered() > 0
    shown.tab.evaluate("live.view.camera.rotate(-40, 15)")
    turned = shown.tab.evaluate("live.view.camera.orientation")
    shown.show(ONE)
    assert shown.tab.evaluate("live.view.camera.orientation") == turned, (
        "a new frame leaves the view as it is"
    )
    shown.tab.get_by_role("button", name="Front view").click()
    assert (
        shown.tab.evaluate("live.view.camera.orientation")
        == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
        != turned
    )


def test_names_and_a_hand_that_leaves(shown: Shown) -> None:
    """Pointing at a joint shows its name and position; for a lost hand the reason is shown."""
    shown.show(BOTH)
    # a joint of the left hand
    tip = len(RIGHT.xyz) + HEADER.skeleton.joint_names.index("index_tip")
    box = shown.tab.locator("#view").bounding_box()
    u, v, _ = shown.tab.evaluate(f"live.view.camera.project(live.scene.joints[{tip}])")
    shown.tab.mouse.move(box["x"] + u, box["y"] + v)
    x, y, z = LEFT.xyz[tip - len(RIGHT.xyz)]
    assert shown.tab.locator("#joint").inner_text() == f"index_tip: {x:.1f}, {y:.1f}, {z:.1f} mm"
    shown.show(ONE)
    assert (
        shown.tab.locator("#hands li").all_inner_texts()[1]
        == "left hand lost 0.1 s: left the image"
    )
    assert shown.tab.evaluate("live.scene.joints.length") == len(RIGHT.xyz)
    shown.show(TrackedFrame(2, 0.2, ()))
    assert shown.tab.locator("#hands li").count() == 0


def test_a_page_that_is_slow_gets_the_newest_frame(shown: Shown) -> None:
    shown.show(BOTH)
    frames = [BOTH._replace(number=number, time=number / 30) for number in range(1, 60)]
    encoded = [shown.messages.view(shown.messages.record(frame), DEPTH, frame) for frame in frames]
    busy = "for (const end = performance.now() + 500; performance.now() < end; );"
    shown.tab.evaluate(f"setTimeout(() => {{ {busy} }})")
    for message in encoded:
        shown.server.put(VIEWS_PATH, message)
    shown.state("frame 59, ")
    assert shown.tab.evaluate("live.drawn") < 20


def test_the_end(serve: Callable[..., LiveServer], visit: Visit) -> None:
    """The page reports the end of the recording, with the last frame, and a stopped tracker."""
    with serve() as server:
        shown = Shown(server, visit)
        shown.show(BOTH)
        shown.put(ONE)
    shown.state("the recording has ended; the last frame is 1")
    assert shown.tab.locator("#hands li").count() == 2
    with pytest.raises(RuntimeError), serve() as server:
        shown = Shown(server, visit)
        raise RuntimeError
    shown.state("the tracker was stopped")


def test_the_token_leaves_the_address(server: LiveServer, browser: Any) -> None:
    """The address bar has no token; a reloaded page continues with it, and another tab
    shows the error.
    """
    address = server.page_url.partition("?")[0]
    context = browser.new_context()
    with contextlib.closing(context):
        tab, other = context.new_page(), context.new_page()
        tab.goto(server.page_url)
        for again in (False, True):
            if again:
                tab.reload()
            tab.locator("#state").filter(has_text="connected").wait_for()
            assert tab.evaluate("location.href") == address
        other.goto(address)
        other.get_by_text("Wrong token. Open the address that the tracker has printed.").wait_for()


def test_one_file_for_one_server() -> None:
    """No external address; a policy that allows only its own script, style and server."""
    text = page(HEADER)
    assert not re.search(
        r"https?://|<link|\bsrc=|url\(|@import|\bimport\s*[({\"']|\beval\(|innerHTML", text
    )
    assert "default-src 'none'; " in text
    assert "connect-src 'self'; " in text
    assert "unsafe" not in text.split("<body>")[0]


def test_a_phone(visit: Visit) -> None:
    """The title is the name of the source; a long one does not make the page wider
    than the screen.
    """
    long = replace(HEADER, source="/home/me/private/takes/" + "recording_" * 10)
    with LiveServer("127.0.0.1", 0, Messages(long).header, page(long)) as server:
        shown = Shown(server, visit)
        shown.show(BOTH)
        assert shown.tab.locator("h1").inner_text() == f"{'recording_' * 10}, tracked"
        assert "private" not in page(long)
        for width in (320, 390):
            shown.tab.set_viewport_size({"width": width, "height": 800})
            assert shown.tab.evaluate("document.documentElement.scrollWidth") == width
