"""The messages of a live track: header and frames as JSON; for the page also depth and surfaces.

The message of a frame for the page is binary; numbers are little-endian:

    uint32              size in bytes of the JSON that follows
    JSON                see below; spaces fill it up to a multiple of 4 bytes
    uint16              depth in mm, 0 where nothing was read: every ``step``-th row and column of a
                        part of the frame that contains the window and the crops; a last 0 fills it
                        up to a multiple of 4 bytes
    float32             8 of each capsule, the hands one after the other: a (x, y, z), b (x, y, z)
                        in mm, camera axes, and the radii at both in mm

The JSON is an object:

    record              the frame as JSON lines have it, without hands that the finder no longer
                        sees
    middle, spread      of the contrast, mm
    window              left, top, width and height of the part to show, px
    grid                left, top, step, columns and rows of the depth
    capsules            how many of each hand
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.joint_formats.formats import FormatName
from handpose.frames.cameras import Camera
from handpose.output.drawing.view import FrameView, Viewport, box_of
from handpose.output.tracks.json_values import FrameValues, header_values, to_text
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from netlib.blob import divide_up

# paths of the server: frames as JSON lines, and those of the page
LINES_PATH, VIEWS_PATH = "/frames", "/view"
MAX_SAMPLES = 320  # maximum side of the depth image sent to the page
_MAX_SAMPLE = np.iinfo(np.uint16).max
_ALIGNMENT = 4  # bytes


class Grid(NamedTuple):
    """Rows and columns of a frame that are sent to the page: from ``left`` and ``top``,
    every ``step``-th.
    """

    left: int
    top: int
    step: int
    columns: int
    rows: int

    def of(self, depth: NDArray[np.floating]) -> NDArray[np.floating]:
        """The samples (rows, columns) of a frame."""
        part = depth[self.top :: self.step, self.left :: self.step]
        return part[: self.rows, : self.columns]


def grid_of(camera: Camera, viewport: Viewport, hands: Sequence[TrackedHand]) -> Grid:
    """The grid that contains the viewport and the crops of the hands, with at most MAX_SAMPLES
    columns and rows.
    """
    right, bottom = viewport.left + viewport.width, viewport.top + viewport.height
    boxes = [(viewport.left, viewport.top, right, bottom)]
    edges = np.array(boxes + [box_of(hand, camera) for hand in hands])
    image = np.array([camera.width, camera.height])
    low = np.floor(np.clip(edges[:, :2].min(axis=0), 0, image)).astype(int)
    high = np.ceil(np.clip(edges[:, 2:].max(axis=0), low, image)).astype(int)
    left, top = low.tolist()
    width, height = (high - low).tolist()
    step = max(1, divide_up(max(width, height), MAX_SAMPLES))
    return Grid(left, top, step, divide_up(width, step), divide_up(height, step))


class Messages:
    """Encodes the frames of one track, in the order of time.

    Every record has the bones of each hand, since a receiver may have missed the frames before.

    joints  as ``open_writer`` has them
    """

    def __init__(self, header: TrackHeader, joints: FormatName | None = None) -> None:
        self.header = to_text(header_values(header, joints))
        self._values = FrameValues(header, joints, live=True)
        self._camera = header.camera
        self._view = FrameView(header.camera)

    def record(self, frame: TrackedFrame) -> dict[str, Any]:
        """The frame as an object."""
        return self._values.values(frame)

    def line(self, record: dict[str, Any]) -> str:
        """The record as a line of JSON, without its end."""
        return to_text(record)

    def view(
        self, record: dict[str, Any], depth: NDArray[np.floating], frame: TrackedFrame
    ) -> bytes:
        """The message for the page."""
        viewport = self._view.see(depth, frame)
        grid = grid_of(self._camera, viewport, frame.hands)
        capsules = [_capsule_rows(hand) for hand in frame.hands]
        unseen = {hand.id for hand in frame.every if not hand.is_seen}
        shown = [hand for hand in record["hands"] if hand["id"] not in unseen]
        values = {
            "record": record | {"hands": shown},
            "middle": self._view.contrast.middle,
            "spread": self._view.contrast.spread,
            "window": [round(edge, 2) for edge in viewport],
            "grid": list(grid),
            "capsules": [len(rows) for rows in capsules],
        }
        text = to_text(values).encode()
        size = _ALIGNMENT * divide_up(len(text), _ALIGNMENT)
        samples = np.clip(grid.of(depth), 0, _MAX_SAMPLE).astype("<u2").tobytes()
        padding = bytes(-len(samples) % _ALIGNMENT)
        parts = [struct.pack("<I", size), text.ljust(size), samples, padding]
        return b"".join([*parts, *(rows.tobytes() for rows in capsules)])


def _capsule_rows(hand: TrackedHand) -> NDArray[np.float32]:
    """The numbers (M, 8) of a hand's capsules; none without a surface."""
    capsules = hand.the_pose.capsules
    if capsules is None:
        return np.empty((0, 8), "<f4")
    radii = capsules.radius_a[0, :, None], capsules.radius_b[0, :, None]
    return np.concatenate([capsules.a[0], capsules.b[0], *radii], axis=1).astype("<f4")
