"""Images of the frames of a track: the hands on the depth image.

painter = Painter(header)
for frame in track:                      # TrackedFrame
    image = painter.picture(depth, frame)    # (height, width, 3) uint8, OpenCV's colour order
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera
from handpose.frames.crops import check_size
from handpose.output.drawing import hands, strokes, surface
from handpose.output.drawing.strokes import Colour, Image
from handpose.output.drawing.view import (
    FrameView,
    Tags,
    Viewport,
    box_of,
    colour_of,
    spoken,
    spoken_loss,
)
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from netlib.blob import Array
from netlib.errors import printable

MAX_WIDTH, MAX_HEIGHT = 960, 720  # pixels of the depth image
HEAD = 32  # pixels of height of the line on top
_INSET = 10  # pixels beside and below its texts
PRESENT_MM = 60.0  # radius of the circle that marks a hand without joints
MAX_LOST, LOST_S = 3, 3.0  # number of lost hands that are listed, and for how many seconds
_INK: Colour = (40, 40, 40)
_MIN_DEPTH_MM = 1.0  # joints behind the camera are drawn at this depth, far outside the image


class Painter:
    """Draws the frames of one track in the order of time; contrast and part of the frame continue
    from frame to frame.

    header  of the track; its camera has the frames' size
    """

    def __init__(self, header: TrackHeader) -> None:
        camera = header.camera
        self.header = header
        zoom = min(MAX_WIDTH / camera.width, MAX_HEIGHT / camera.height)
        self._size = max(round(camera.width * zoom), 1), max(round(camera.height * zoom), 1)
        self._view = FrameView(camera)

    def picture(self, depth: NDArray[np.floating], frame: TrackedFrame) -> Image:
        """``seen`` below a line with the source and the time, which is HEAD pixels high.

        Raises DataError.
        """
        seen = self.seen(depth, frame)
        head = np.full((HEAD, seen.shape[1], 3), 255, dtype=np.uint8)
        raw = "" if self.header.smoothed else ", not smoothed"
        width = seen.shape[1]
        middle = seen.shape[1] * 2 // 3
        source = f"{self.header.source}{raw}"
        moment = f"{frame.time:.2f} s, frame {frame.number}"
        for words, left, right in ((source, 0, middle), (moment, middle, width)):
            at = np.array([left + _INSET, HEAD - _INSET])
            room = right - left - 2 * _INSET
            strokes.text_within(head, printable(words), at, _INK, 0.55, room)
        return np.concatenate([head, seen])

    def seen(self, depth: NDArray[np.floating], frame: TrackedFrame) -> Image:
        """The part of the depth image around the hands, with the hands on it, (height, width, 3).

        depth  in mm, 0 without a reading

        A present hand that the finder looked for and did not see is not drawn. Raises DataError.
        """
        check_size(depth, self.header.camera)
        part = _Part(self._view.see(depth, frame), self.header.camera, self._size)
        grey = part.of(self._view.contrast.grey(depth))
        canvas = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
        for hand in sorted(frame.hands, key=lambda one: -float(one.xyz[:, 2].mean())):
            low, high = part.corners(hand)
            cv2.rectangle(canvas, _pixel(low), _pixel(high), colour_of(hand.id), 1, cv2.LINE_AA)
            self._hand(canvas, hand, part.camera)
        frame = frame._replace(every=tuple(hand for hand in frame.every if hand.is_seen))
        for present in frame.present:
            _present(canvas, present, part)
        _tags(canvas, frame, part)
        return canvas

    def _hand(self, canvas: Image, hand: TrackedHand, camera: Camera) -> None:
        """Draw surface and skeleton."""
        capsules = hand.the_pose.capsules
        if capsules is not None:
            surface.paint(canvas, capsules, camera)
        uvd = camera.project(np.maximum(hand.xyz, (-np.inf, -np.inf, _MIN_DEPTH_MM)))
        guesses = hands.guessed(hand.finger_error_mm)
        hands.draw(canvas, uvd[:, :2], uvd[:, 2], self.header.skeleton, thick=2, guesses=guesses)


class _Part:
    """A part of a camera's frame in an image of this width and height; ``camera``
    sees the image.
    """

    def __init__(self, viewport: Viewport, camera: Camera, size: tuple[int, int]) -> None:
        self._size = size
        self._frame = camera
        self._zoom = np.array(size) / viewport[2:]
        self._corner = np.array(viewport[:2])
        across, down = self._zoom
        left, top = 0.5 - self._corner
        self._is_reduced = viewport.width == camera.width and across < 1
        fx, fy = camera.fx * across, camera.fy * down
        u0, v0 = (camera.u0 + left) * across - 0.5, (camera.v0 + top) * down - 0.5
        self.camera = Camera(camera.name, fx, fy, u0, v0, *size)
        shift_x, shift_y = left * across - 0.5, top * down - 0.5
        self._move = np.array([[across, 0, shift_x], [0, down, shift_y]])

    def of(self, grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The part of a grey image of the frame."""
        if self._is_reduced:
            return np.asarray(
                cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA), dtype=np.uint8
            )
        moved = cv2.warpAffine(
            grey, self._move, self._size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(moved, dtype=np.uint8)

    def corners(self, hand: TrackedHand) -> Array:
        """Upper left and lower right corner (2, 2) of a hand's crop."""
        corners = np.reshape(box_of(hand, self._frame), (2, 2))
        return (corners - self._corner) * self._zoom - 0.5


def _present(canvas: Image, hand: TrackedHand, part: _Part) -> None:
    """Draw the outline of the pixels of a hand without joints, or a circle about its middle."""
    colour = colour_of(hand.id)
    if hand.mask is not None:
        seen = part.of(np.where(hand.mask, np.uint8(255), np.uint8(0))) > 127
        outlines, _ = cv2.findContours(
            seen.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
        )
        cv2.drawContours(canvas, outlines, -1, colour, 2, cv2.LINE_AA)
        return
    u, v, d = part.camera.project(hand.place)
    middle = _pixel(np.array([u, v]))
    radius = round(PRESENT_MM * part.camera.fx / d)
    cv2.circle(canvas, middle, radius, colour, 2, cv2.LINE_AA)


def _tags(canvas: Image, frame: TrackedFrame, part: _Part) -> None:
    """Label the hands, their confidence and gestures above their crops; list hands that were lost a
    short time ago and reasons at the bottom.
    """
    tags = Tags(canvas)
    recent = [lost for lost in frame.lost if frame.time - lost.since <= LOST_S]
    for lost in sorted(recent, key=lambda lost: -lost.since)[:MAX_LOST]:
        tags.add(spoken_loss(lost, frame.time), 0, len(canvas), colour_of(lost.id))
    for present in frame.present:
        u, v, d = part.camera.project(present.place)
        top = v - PRESENT_MM * part.camera.fy / d
        tags.add(spoken(present), u, top, colour_of(present.id), sure=False)
    for hand in frame.hands:
        left, top = part.corners(hand)[0]
        is_decided = hand.known_side is not None
        tags.add(spoken(hand), left, top, colour_of(hand.id), sure=is_decided)


def _pixel(point: Array) -> tuple[int, int]:
    """A point for cv2, clipped to the range that it accepts."""
    x, y = np.rint(np.clip(point, -1e4, 1e4)).astype(int)
    return int(x), int(y)
