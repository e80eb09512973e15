"""The messages of a live track: header and frames as JSON; for the page also depth and surfaces.

The message of a frame for the page is binary; numbers are little-endian:

    uint32              size in bytes of the JSON that follows
    JSON                record (the frame as JSON lines have it, without hands that the finder
                        no longer sees), middle and spread
                        (mm, of the contrast), window (left, top, width and height of the part to
                        show, px), grid (left, top, step, columns, rows of the depth), capsules
                        (how many of each hand); spaces fill it up to a multiple of 4
    uint16              depth in mm, 0 where nothing was read: every ``step``-th row and column of a
                        part of the frame that contains the window and the crops; a last 0 fills it
                        up to a multiple of 4 bytes
    float32             8 of each capsule, the hands one after the other: a (x, y, z), b (x, y, z)
                        in mm, camera axes, and the radii at both in mm
"""

from __future__ import annotations

import math
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
        rows = slice(self.top, self.top + self.rows * self.step, self.step)
        return depth[rows, self.left : self.left + self.columns * self.step : self.step]


def grid_of(camera: Camera, viewport: Viewport, hands: Sequence[TrackedHand]) -> Grid:
    """The grid that contains the viewport and the crops of the hands, with at most MAX_SAMPLES
    columns and rows.
    """
    right, bottom = viewport.left + viewport.width, viewport.top + viewport.height
    boxes = [(viewport.left, viewport.top, right, bottom)]
    edges = np.array(boxes + [box_of(hand, camera) for hand in hands])
    size = np.array([camera.width, camera.height])
    low = np.floor(np.clip(edges[:, :2].min(axis=0), 0, size)).astype(int)
    high = np.ceil(np.clip(edges[:, 2:].max(axis=0), low, size)).astype(int)
    step = max(1, math.ceil(int((high - low).max()) / MAX_SAMPLES))
    columns, rows = -(-(high - low) // step)
    return Grid(int(low[0]), int(low[1]), step, int(columns), int(rows))


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
        surfaces = [hand.the_pose.capsules for hand in frame.hands]
        counts = [0 if surface is None else surface.a.shape[1] for surface in surfaces]
        unseen = {hand.id for hand in frame.every if not hand.is_seen}
        shown = [hand for hand in record["hands"] if hand["id"] not in unseen]
        values = {
            "record": record | {"hands": shown},
            "middle": self._view.contrast.middle,
            "spread": self._view.contrast.spread,
            "window": [round(edge, 2) for edge in viewport],
            "grid": list(grid),
            "capsules": counts,
        }
        text = to_text(values).encode()
        samples = np.clip(grid.of(depth), 0, _MAX_SAMPLE).astype("<u2")
        size = 4 * divide_up(len(text), 4)
        padding = bytes(2 * (samples.size % 2))
        parts = [struct.pack("<I", size), text.ljust(size), samples.tobytes(), padding]
        for surface in surfaces:
            if surface is not None:
                radii = surface.radius_a[0, :, None], surface.radius_b[0, :, None]
                parts.append(
                    np.concatenate([surface.a[0], surface.b[0], *radii], axis=1)
                    .astype("<f4")
                    .tobytes()
                )
        return b"".join(parts)
