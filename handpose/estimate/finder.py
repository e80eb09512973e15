"""Hands in whole depth frames, also beside bodies, tables and objects: where, and which pixels.

A fully convolutional network sees the frame at a focal length of ``FINDER_FOCAL_PX``. Each pixel
on a hand votes for the middle of its joints; a found hand is a local maximum of the presence,
placed by the votes around it. Pixels of a hand belong to the found middle that is nearest to their
vote. Where nothing was read there are no votes and no mask.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import CUBE_MM
from handpose.body.sides import MIRROR, SideView
from handpose.estimate.hand import MIN_PRESENCE
from handpose.fit.rounding import PLACE_STEP_MM, rounded
from handpose.fit.settings import FinderSettings
from handpose.frames.cameras import FINDER_FOCAL_PX, Camera, Floats
from handpose.frames.crops import check_size
from handpose.frames.images import depth_image
from netlib.blob import Array
from netlib.errors import NetlibError
from netlib.net import Net

VOTE_MM = 100.0  # unit of the votes
NEAREST_MM = 100.0  # minimum range of depth cameras
BEYOND_MM, MIDDLE_MM = 4000.0, 600.0  # farther readings are ignored; depth with logarithm 0
STRIDE = 32  # heights and widths of the net's input are multiples
MAX_PIXELS = 1 << 19  # of the net's input; larger frames are seen smaller
CHANCE_STEP = 2.0**-10  # to which probabilities are rounded, so that processors agree
WEIGHT_STEP = 2.0**-5  # likewise, of weights: a rough one hardly ever rounds to another
MIN_VOTES = 1e-4  # sum of the weights around a maximum
# channels, part of the resolution
OUTPUTS = {"class": (3, 2), "presence": (1, 4), "votes": (3, 4)}


class FoundHand(NamedTuple):
    """A hand in a frame.

    presence  from 0 to 1: how sure it is that this is a hand
    middle    (3,) mm, the mean of its joints without the wrist, camera axes
    mask      (height, width) the hand's pixels in the frame
    weight    (height, width) of each pixel in a fit, 0 to 1: the probability that it shows this
              hand, and some doubt; None: all are alike
    """

    presence: float
    middle: Array
    mask: NDArray[np.bool_]
    weight: Floats | None = None

    def mirrored(self) -> FoundHand:
        """The hand in the mirror image of its frame."""
        weight = None if self.weight is None else self.weight[:, ::-1]
        return FoundHand(self.presence, self.middle * MIRROR, self.mask[:, ::-1], weight)


class Finder:
    """A net with the input frame (N, 4, H, W) and the outputs of ``OUTPUTS``.

    settings  tuned numbers

    Raises NetlibError.
    """

    def __init__(self, net: Net, settings: FinderSettings = FinderSettings()) -> None:
        if "frame" not in net.blobs or net.blobs["frame"].shape[1:2] != (4,):
            raise NetlibError(
                f"{net.source}: no blob 'frame' of shape (N, 4, H, W), the input of a finder"
            )
        height, width = net.blobs["frame"].shape[2:]
        for name, (channels, part) in OUTPUTS.items():
            found = net.blobs[name].shape[1:] if name in net.blobs else None
            expected = (channels, height // part, width // part)
            if found != expected:
                raise NetlibError(
                    f"{net.source}: blob {name!r} of shape {found} an item, expected "
                    f"{expected} of a finder"
                )
        self.net, self.settings = net, settings

    def hands_in(
        self, frame: SideView, min_presence: float = MIN_PRESENCE, most: int = 4
    ) -> list[FoundHand]:
        """The hands in a frame, found in its view and given as the camera sees them; arguments and
        errors as of ``hands``.
        """
        found = self.hands(frame.depth, frame.camera, min_presence, most)
        return [hand.mirrored() for hand in found] if frame.side == "left" else found

    def hands(
        self,
        depth: NDArray[np.generic],
        camera: Camera,
        min_presence: float = MIN_PRESENCE,
        most: int = 4,
    ) -> list[FoundHand]:
        """The hands in a depth frame (height, width) in mm, 0 where there is no reading, the most
        certain first.

        Raises DataError for a frame of another size than the camera's, NetlibError for outputs that
        are not finite.
        """
        image = depth_image(depth)
        check_size(image, camera)
        image = np.asarray(camera.in_range(image), np.float32)
        scale = _scale(camera)
        small = _scaled(image, scale)
        slopes = _slopes(camera, scale, small.shape)
        focal = float(camera.fx * scale[0])
        hand, presence, to_middles = self._answers(small, focal)
        z = small[::4, ::4].astype(np.float64)
        z[z >= BEYOND_MM] = 0
        rays = np.concatenate([slopes[::4, ::4], np.ones((*z.shape, 1))], axis=-1)
        points = rays * z[..., None]
        votes = points + to_middles
        weight = (z > 0) * np.maximum(hand[::2, ::2], 1e-3)
        peaks = [
            (chance, middle)
            for chance, middle in self._peaks(presence, votes, weight, min_presence, most)
            if _in_sight(middle, camera)
        ]
        if not peaks:
            return []
        middles = np.stack([middle for _, middle in peaks])
        owner = np.linalg.norm(votes[:, :, None] - middles, axis=-1).argmin(-1)
        maps = [hand, *self._weights(hand, owner, len(peaks))]
        in_frame, *weights = _in_frame(maps, camera, scale)
        masks = self._masks(image, camera, scale, in_frame, owner, middles)
        rough = [rounded(weight, WEIGHT_STEP).astype(np.float32) for weight in weights]
        return [FoundHand(*peak, *pixels) for peak, *pixels in zip(peaks, masks, rough)]

    def _answers(self, frame: Floats, focal: float) -> tuple[Floats, Floats, Array]:
        """The net's answers to a frame (H, W) in mm with a focal length in px: the probability of
        hands (H/2, W/2), the presence (H/4, W/4) of middles, and the offsets (H/4, W/4, 3) in mm
        of the middles of the hands from their points.

        Raises NetlibError for answers that are not finite.
        """
        said = self.net.forward(blobs=["votes", "class"], frame=channels_of(frame[None], focal))
        if not all(np.isfinite(said[name]).all() for name in OUTPUTS):
            raise NetlibError(f"{self.net.source}: answers that are not finite; check its weights")
        chances = said["class"][0, 1], said["presence"][0, 0]
        hand, presence = (rounded(values, CHANCE_STEP).astype(np.float32) for values in chances)
        offsets = rounded(VOTE_MM * np.moveaxis(said["votes"][0], 0, -1), PLACE_STEP_MM)
        return hand, presence, offsets

    def _peaks(
        self, presence: Floats, votes: Array, weight: Array, min_presence: float, most: int
    ) -> list[tuple[float, Array]]:
        """The highest maxima of the presence (h, w) and the middles (3,) that the votes (h, w, 3)
        around them mean.
        """
        highest = cv2.dilate(presence, np.ones((3, 3), np.uint8))
        rows, columns = np.nonzero((presence == highest) & (presence >= min_presence))
        kept: list[tuple[float, Array]] = []
        for n in np.argsort(-presence[rows, columns], kind="stable"):
            row, column = int(rows[n]), int(columns[n])
            top, left = max(row - 2, 0), max(column - 2, 0)
            around = np.s_[top : row + 3, left : column + 3]
            own = weight[around].ravel()
            if own.sum() < MIN_VOTES:
                continue
            middle = self._agreed(votes[around].reshape(-1, 3), own)
            if all(np.linalg.norm(middle - other) > self.settings.apart_mm for _, other in kept):
                kept.append((float(presence[row, column]), middle))
            if len(kept) == most:
                break
        return kept

    def _agreed(self, votes: Array, weight: Array) -> Array:
        """The mean (3,) of the votes (n, 3) near their median, so that those of a wall behind a
        hand do not count.
        """
        order = votes.argsort(axis=0)
        half = weight[order].cumsum(axis=0) >= weight.sum() / 2
        median = np.take_along_axis(votes, order, axis=0)[half.argmax(axis=0), range(3)]
        near = weight * (np.linalg.norm(votes - median, axis=1) < self.settings.apart_mm)
        return near @ votes / near.sum() if near.any() else median

    def _weights(self, hand: Floats, owner: NDArray[np.intp], hands: int) -> list[Floats]:
        """The weights (H/2, W/2) of the pixels of each hand.

        hand   (H/2, W/2) probability of hands
        owner  (H/4, W/4) number of the hand that a pixel votes for
        """
        doubt = np.float32(self.settings.doubt)
        nearest = owner.repeat(2, axis=0).repeat(2, axis=1)
        weight = doubt + (1 - doubt) * hand
        return [np.where(nearest == k, weight, doubt) for k in range(hands)]

    def _masks(
        self,
        image: Floats,
        camera: Camera,
        scale: Array,
        hand: Floats,
        owner: NDArray[np.intp],
        middles: Array,
    ) -> NDArray[np.bool_]:
        """The pixels (K, height, width) of the frame that belong to each middle.

        hand   (height, width) probability of hands
        owner  (H/4, W/4) number of the middle that a pixel votes for
        """
        is_hand = (hand > 0.5) & (image > 0) & (image < BEYOND_MM)
        rows, columns = np.nonzero(is_hand)
        quarter_row = np.rint(rows * scale[1] / 4).astype(int).clip(0, owner.shape[0] - 1)
        quarter_column = np.rint(columns * scale[0] / 4).astype(int).clip(0, owner.shape[1] - 1)
        own = owner[quarter_row, quarter_column]
        points = camera.unproject(np.stack([columns, rows, image[rows, columns]], axis=-1))
        within_cube = np.linalg.norm(points - middles[own], axis=1) < CUBE_MM / 2
        own = np.where(within_cube, own, -1)
        masks = np.zeros((len(middles), *image.shape), bool)
        for k in range(len(middles)):
            masks[k, rows[own == k], columns[own == k]] = True
        return masks


def _in_frame(maps: Sequence[Floats], camera: Camera, scale: Array) -> list[Floats]:
    """Maps (H/2, W/2) of the net, interpolated at the pixels (height, width) of the frame."""
    u = np.arange(camera.width, dtype=np.float32) * np.float32(scale[0])
    v = np.arange(camera.height, dtype=np.float32) * np.float32(scale[1])
    x, y = np.meshgrid(u / 2, v / 2)
    border = cv2.BORDER_REPLICATE
    shown = (cv2.remap(one, x, y, cv2.INTER_LINEAR, borderMode=border) for one in maps)
    return [np.asarray(one, np.float32) for one in shown]


def channels_of(depth: Floats, focal: float = FINDER_FOCAL_PX) -> Floats:
    """Frames (N, H, W) in mm as the net's input (N, 4, H, W): read or not, logarithm of depth,
    slopes across and down.

    A slope is the sine of the surface's angle to the image plane, 0 beside pixels
    without a reading.
    """
    read = (depth > 0) & (depth < BEYOND_MM)
    z = np.where(read, depth, np.float32(MIDDLE_MM))
    out = np.zeros((len(depth), 4, *depth.shape[1:]), np.float32)
    out[:, 0] = read
    out[:, 1] = np.clip(np.log(z / MIDDLE_MM), -1.5, 1.5)
    for channel, axis in ((2, 2), (3, 1)):
        before, at, after = ([slice(None)] * 3 for _ in range(3))
        before[axis] = slice(None, -2)
        at[axis] = slice(1, -1)
        after[axis] = slice(2, None)
        first, here, last = tuple(before), tuple(at), tuple(after)
        slope = (z[last] - z[first]) * (0.5 * focal) / z[here]
        slope /= np.sqrt(1 + slope * slope)
        out[:, channel][here] = slope * (read[first] & read[here] & read[last])
    return out


def _scale(camera: Camera) -> Array:
    """Factors of columns and rows from the camera's frames to the net's."""
    scale = FINDER_FOCAL_PX / np.array([camera.fx, camera.fy])
    pixels = camera.width * camera.height * scale.prod()
    return scale * min(1.0, (MAX_PIXELS / pixels) ** 0.5)


def _scaled(image: Floats, scale: Array) -> Floats:
    """The nearest pixels at the net's resolution, padded with 0 to multiples of ``STRIDE``."""
    height, width = image.shape
    columns = np.rint(np.arange(max(1, int(width * scale[0]))) / scale[0])
    rows = np.rint(np.arange(max(1, int(height * scale[1]))) / scale[1])
    row, column = rows.astype(int).clip(0, height - 1), columns.astype(int).clip(0, width - 1)
    padded = [-(-count // STRIDE) * STRIDE for count in (len(rows), len(columns))]
    out = np.zeros(padded, np.float32)
    out[: len(rows), : len(columns)] = image[np.ix_(row, column)]
    return out


def _slopes(camera: Camera, scale: Array, shape: tuple[int, ...]) -> Array:
    """x / z and y / z (H, W, 2) of the rays through the pixels of ``_scaled``."""
    x = (np.arange(shape[1]) / scale[0] - camera.u0) / camera.fx
    y = (camera.v0 - np.arange(shape[0]) / scale[1]) / camera.fy
    return np.stack(np.meshgrid(x, y), axis=-1)


def _in_sight(middle: Array, camera: Camera) -> bool:
    """Whether a place (3,) is in the image, not at the camera."""
    if middle[2] < NEAREST_MM:
        return False
    u, v, _ = camera.project(middle)
    return bool(camera.has_pixel(u, v))
