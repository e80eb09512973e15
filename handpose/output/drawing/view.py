"""What pictures of a track share: the shown part of the frame, the contrast, and the
labels of hands.

Part and contrast follow the hands slowly, so that a video neither jerks nor flickers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera
from handpose.output.drawing import strokes
from handpose.output.drawing.strokes import Colour, Image
from handpose.tracking.track import TrackedFrame, TrackedHand
from netlib.blob import Array

SECONDS = 0.5  # time constant of a move
MARGIN = 1.1  # of the crops of all hands
MAX_ZOOM = 5.0  # at least a fifth of the frame is shown


class Viewport(NamedTuple):
    """A part of a frame in pixels; the pixel in column c covers c to c + 1.

    Parts have the frame's aspect ratio.
    """

    left: float
    top: float
    width: float
    height: float


class _Follower:
    """Follows values that change, with a time constant in s; the first values are taken at once."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._time = 0.0
        self._state: Array | None = None

    def follow(self, time: float, wanted: Array) -> Array:
        """The followed values at a time in s."""
        if self._state is None:
            self._state = wanted
        else:
            part = 1 - np.exp(-max(time - self._time, 0.0) / self._seconds)
            self._state = self._state + part * (wanted - self._state)
        self._time = time
        return self._state


class ViewportFollower:
    """Follows the hands in the frames of one camera, in the order of time; without hands it is
    the whole frame.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        # of middle u, v and the logarithm of the width in frame widths
        self._follower = _Follower(SECONDS)

    def see(self, time: float, hands: Sequence[TrackedHand]) -> Viewport:
        """The part to show at a time in s."""
        state = self._follower.follow(time, self._around(hands))
        frame = np.array([self._camera.width, self._camera.height], np.float64)
        size = frame * min(float(np.exp(state[2])), 1.0)
        corner = np.clip(state[:2] - size / 2, 0, frame - size)
        return Viewport(float(corner[0]), float(corner[1]), float(size[0]), float(size[1]))

    def _around(self, hands: Sequence[TrackedHand]) -> Array:
        width, height = self._camera.width, self._camera.height
        if not hands:
            return np.array([width / 2, height / 2, 0.0])
        boxes = np.array([box_of(hand, self._camera) for hand in hands])
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        low, high = np.clip(low, 0, (width, height)), np.clip(high, 0, (width, height))
        part = MARGIN * float(((high - low) / (width, height)).max())
        return np.array([*(low + high) / 2, np.log(np.clip(part, 1 / MAX_ZOOM, 1))])


def box_of(hand: TrackedHand, camera: Camera) -> tuple[float, float, float, float]:
    """Left, top, right and bottom edge in pixels of the middle plane of a hand's crop."""
    pose = hand.the_pose
    u, v, d = pose.center_uvd
    u, v = u + 0.5, v + 0.5  # from the corner of the image
    across = camera.fx * pose.cube_mm / 2 / d
    down = camera.fy * pose.cube_mm / 2 / d
    return u - across, v - down, u + across, v + down


# ----------------------------------------------------------------------------------------- contrast

CONTRAST_S = 0.7  # time constant of a change of contrast
SPREAD_MM = 90.0  # in front of and behind the hands: the range with most of the greys
_MAX_DEPTH = (1 << 14) - 1  # mm; everything beyond is equally dark
_DARK, _LIGHT = 40.0, 230.0


class Contrast:
    """The mapping from depth to grey: nearer is lighter, steepest at the hands, black
    without a reading.

    middle  the depth in mm with medium grey, from the first ``see`` on
    spread  the distance in mm from ``middle`` that spans seven tenths of the greys of one
            side, likewise
    """

    middle: float
    spread: float

    def __init__(self) -> None:
        self._follower = _Follower(CONTRAST_S)

    def see(self, time: float, depth: NDArray[np.floating], hands: Array) -> None:
        """Follow the depths (n,) in mm of all joints at a time in s; without any, the nearer
        half of the scene.
        """
        if len(hands):
            nearest, farthest = hands.min(), hands.max()
            middle, spread = (farthest + nearest) / 2, SPREAD_MM + (farthest - nearest) / 4
        else:
            middle, spread = _nearer_half(depth)
        self.middle, self.spread = self._follower.follow(time, np.array([middle, spread])).tolist()

    def grey(self, depth: NDArray[np.floating]) -> NDArray[np.uint8]:
        """The image (height, width) of a depth image in mm."""
        away = (np.arange(_MAX_DEPTH + 1) - self.middle) / self.spread
        lightness = 0.5 - 0.5 * away / np.hypot(1, away)
        shades = np.rint(_DARK + (_LIGHT - _DARK) * lightness).astype(np.uint8)
        shades[0] = 0
        return shades[np.minimum(depth, _MAX_DEPTH).astype(np.uint16)]


def _nearer_half(depth: NDArray[np.floating]) -> tuple[float, float]:
    """The middle and half of the range in mm that contains the nearer half of the readings."""
    read = depth[::4, ::4]
    read = read[read > 0]
    near, far = np.percentile(read, (2, 50)) if len(read) else (600.0, 800.0)
    return float(near + far) / 2, max(float(far - near) / 2, SPREAD_MM)


class FrameView:
    """What pictures show of the frames of one camera, in the order of time: their contrast, and
    the part of each frame.
    """

    def __init__(self, camera: Camera) -> None:
        self.contrast = Contrast()
        self._follower = ViewportFollower(camera)

    def see(self, depth: NDArray[np.floating], frame: TrackedFrame) -> Viewport:
        """The part to show of a frame with a depth image in mm."""
        joints = np.concatenate([np.empty((0, 3)), *(hand.xyz for hand in frame.hands)])
        self.contrast.see(frame.time, depth, joints[:, 2])
        return self._follower.see(frame.time, frame.hands)


# ------------------------------------------------------------------------------------------- labels

# Blue, green, red: dark enough for white letters on them.
ID_COLOURS: tuple[Colour, ...] = (
    (190, 110, 25),
    (30, 95, 210),
    (60, 130, 40),
    (160, 55, 150),
    (60, 60, 60),
    (130, 130, 0),
)

TAG_HEIGHT = 22  # pixels
_WORDS = 0.55  # scale of text
_BESIDE = 6  # pixels of background left and right of the text
_BELOW = 5  # pixels of background below it


def colour_of(id: int) -> Colour:
    """The colour of the hand with this id."""
    return ID_COLOURS[id % len(ID_COLOURS)]


def percent(confidence: float) -> str:
    """``93%``; ``>99%`` for what would be rounded to 100%, since no estimate is certain."""
    return ">99%" if confidence >= 0.995 else f"{confidence:.0%}"


def spoken(hand: TrackedHand) -> str:
    """``right 93%``, ``right? 49%`` while the side is assumed; ``left hand 43%``, its presence,
    without joints; ``right 93%, thumb up`` with a gesture.

    The number is omitted if it was not measured.
    """
    if hand.pose is None:
        side = f"{hand.hand} hand" if hand.hand else "hand"
        chance = hand.presence
    else:
        side = hand.known_side or f"{hand.hand}?"
        chance = hand.confidence
    label = f"{side} {percent(chance)}" if math.isfinite(chance) else side
    if hand.gesture is None or not hand.gesture.name:
        return label
    return f"{label}, {hand.gesture.name.replace('_', ' ')}"


def spoken_loss(hand: TrackedHand, time: float) -> str:
    """``left hand lost 0.4 s: it left the image``."""
    which = f"{hand.hand} hand" if hand.hand else "hand"
    return f"{which} lost {max(time - hand.since, 0):.1f} s: {hand.reason}"


class Tags:
    """The tags of one image."""

    def __init__(self, canvas: Image) -> None:
        self._canvas = canvas
        self._taken: list[tuple[int, int, int]] = []  # left, right, top

    def add(
        self, words: str, left: float, bottom: float, colour: Colour, *, sure: bool = True
    ) -> None:
        """Add a tag with its lower left corner as close to the point as possible, above
        rather than below.

        Unless it is ``sure``, the text is coloured on white.
        """
        height, width = self._canvas.shape[:2]
        scale = strokes.scale_within(words, _WORDS, width - 2 * _BESIDE)
        wide = strokes.text_width(words, scale) + 2 * _BESIDE
        x = int(np.clip(left, 0, max(width - wide, 0)))
        wanted = int(np.clip(bottom - TAG_HEIGHT, 0, height - TAG_HEIGHT))
        places = range(wanted % TAG_HEIGHT, height - TAG_HEIGHT + 1, TAG_HEIGHT)
        nearest_first = sorted(places, key=lambda y: (abs(y - wanted), y))
        y = next((y for y in nearest_first if not self._hits(x, x + wide, y)), wanted)
        self._taken.append((x, x + wide, y))
        white = (255, 255, 255)
        right, low = x + wide - 1, y + TAG_HEIGHT - 1
        cv2.rectangle(self._canvas, (x, y), (right, low), colour, -1)
        if not sure:
            cv2.rectangle(self._canvas, (x + 2, y + 2), (right - 2, low - 2), white, -1)
        at = np.array([x + _BESIDE, low - _BELOW])
        strokes.text(self._canvas, words, at, white if sure else colour, scale)

    def _hits(self, left: int, right: int, top: int) -> bool:
        beside = [own for own in self._taken if abs(top - own[2]) < TAG_HEIGHT]
        return any(left < end and right > start for start, end, _ in beside)
