"""handpose/output/live/messages.py"""

from __future__ import annotations

import dataclasses
import json
import re
import struct

import numpy as np

from handpose.body.gestures import GestureReader
from handpose.frames.cameras import CAMERAS
from handpose.output.drawing.view import Viewport, ViewportFollower
from handpose.output.live.messages import MAX_SAMPLES, Grid, Messages, grid_of
from handpose.output.tracks.json_values import FrameValues, header_values
from handpose.tracking.track import TrackedFrame
from tests.handpose.output.live.conftest import BOTH, DEPTH, ONE, RIGHT
from tests.support import json_schema
from tests.support.running import ROOT
from tests.support.tracked_hands import CAMERA, HEADER, present, tracked, with_pose


def test_records_are_those_of_a_track_with_the_bones_in_each() -> None:
    """Every record has the bones, because a receiver may have missed some; joints before smoothing
    are for files.
    """
    raw = with_pose(RIGHT, raw_xyz=RIGHT.xyz)
    messages, values = Messages(HEADER), FrameValues(HEADER)
    assert json.loads(messages.header) == json.loads(json.dumps(header_values(HEADER)))
    assert not json_schema.faults(json.loads(messages.header), "header")
    for frame in (BOTH, ONE, TrackedFrame(2, 0.2, (raw,))):
        assert not json_schema.faults(messages.record(frame), "frame")
        found, expected = json.loads(messages.line(messages.record(frame))), values.values(frame)
        assert all(len(hand.pop("bones_mm")) == 31 for hand in found["hands"])
        for hand in expected["hands"]:
            assert ("raw_positions_mm" in hand) == (frame.number == 2)
            for key in ("bones_mm", "raw_positions_mm"):
                hand.pop(key, None)
        assert found == json.loads(json.dumps(expected))


def test_joints_and_gestures() -> None:
    messages = Messages(HEADER, "mano")
    assert json.loads(messages.header)["joint_format"]["name"] == "mano"
    read = BOTH.with_gestures(GestureReader(HEADER.skeleton))
    hand = messages.record(read)["hands"][0]
    assert len(hand["mano"]["positions_m"]) == 21 and hand["gesture"]["name"] == "open"


def test_large_frames_are_sampled() -> None:
    """Images of 640 x 480 pixels are subsampled by 2; the message is padded to 4 bytes; far
    depths are clipped.
    """
    for camera in CAMERAS.values():
        grid = grid_of(camera, ViewportFollower(camera).see(0.0, ()), ())
        assert grid.step == (2 if camera.width > MAX_SAMPLES else 1)
        assert max(grid.columns, grid.rows) <= MAX_SAMPLES
        assert grid.of(np.zeros((camera.height, camera.width))).shape == (grid.rows, grid.columns)
    camera = dataclasses.replace(HEADER.camera, width=642, height=482)
    messages, frame = Messages(dataclasses.replace(HEADER, camera=camera)), TrackedFrame(0, 0.0, ())
    message = messages.view(messages.record(frame), np.full((482, 642), 1e6, np.float32), frame)
    (size,) = struct.unpack_from("<I", message)
    samples = np.frombuffer(message[4 + size :], "<u2")
    assert len(samples) == 214 * 161 and (samples == 65535).all()
    odd = Messages(
        dataclasses.replace(HEADER, camera=dataclasses.replace(camera, width=3, height=3))
    )
    message = odd.view(odd.record(frame), np.ones((3, 3), np.float32), frame)
    assert len(message) % 4 == 0


def test_the_part_around_a_hand_is_sent_with_all_its_pixels() -> None:
    """The grid contains the viewport and the crops within the frame, as whole pixels."""
    camera = dataclasses.replace(CAMERA, width=1600, height=1200, fx=1470, fy=1470, u0=800, v0=600)
    viewport = Viewport(700.5, 500.5, 200.0, 150.0)
    assert grid_of(camera, viewport, ()) == Grid(700, 500, 1, 201, 151)
    # a crop of 735 px, partly outside
    hand = with_pose(RIGHT, center_uvd=np.array([100.0, 600.0, 600.0]))
    grid = grid_of(camera, viewport, [hand])
    assert (grid.left, grid.left + grid.step * grid.columns) == (0, 903)
    assert grid.step == 3
    assert grid.of(np.zeros((1200, 1600))).shape == (grid.rows, grid.columns)


def test_the_page_has_no_hand_that_the_finder_no_longer_sees() -> None:
    """Other programs have all."""
    unseen = present(2, 0.4, 0.0, is_seen=False)
    messages, frame = Messages(HEADER), TrackedFrame(0, 0.0, (RIGHT, unseen, present(3, 0.9, 0.0)))
    record = messages.record(frame)
    assert [hand["id"] for hand in record["hands"]] == [1, 2, 3]
    message = messages.view(record, DEPTH, frame)
    (size,) = struct.unpack_from("<I", message)
    shown = json.loads(message[4 : 4 + size])["record"]
    assert [hand["id"] for hand in shown["hands"]] == [1, 3]


def test_the_documented_size_of_a_frame_for_the_page() -> None:
    """Of two hands in 640 x 480 pixels, with joints and gestures, while the whole
    frame is shown.
    """
    (most,) = re.findall(
        r"A frame has at most (\d+) kB for the page", (ROOT / "docs" / "live.md").read_text()
    )
    camera = dataclasses.replace(
        HEADER.camera, width=640, height=480, fx=588.0, fy=588.0, u0=320.0, v0=240.0
    )
    edges = [tracked("right", (-300, 200, 600), 1), tracked("left", (300, -200, 600), 2)]
    hands = tuple(with_pose(hand, center_uvd=camera.project(hand.pose.origin_mm)) for hand in edges)
    frame = TrackedFrame(0, 0.0, hands).with_gestures(GestureReader(HEADER.skeleton))
    messages = Messages(dataclasses.replace(HEADER, camera=camera), "mano")
    message = messages.view(messages.record(frame), np.full((480, 640), 1000, np.float32), frame)
    assert 0.9 * int(most) < len(message) / 1000 <= int(most)
