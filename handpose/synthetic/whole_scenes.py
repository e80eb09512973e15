"""Whole depth frames of ordinary scenes, with labels: people with one or two hands, tables,
things, walls.

A scene is drawn from a hand outwards. The hand lies anywhere in the frame, turned anyhow; its
forearm leads to the person's upper arm, shoulders, head, trunk and legs, and these to the other
hand. The camera is on the person's head, or anywhere around. The table may be nearer than the
hands; things stand on it, in the room, hang in the air, or are held. How often, how large and where
is the scene prior's (``scenes.prior``).

Frames have a focal length of about ``FINDER_FOCAL_PX``, or a multiple of it. A block of
``SCENES_PER_BLOCK`` scenes depends on the seed, the split and its number alone. Axes are the
camera's: x right, y up, z away, in mm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Floats
from handpose.synthetic import prior_file
from handpose.synthetic.frame_errors import measure_fine, measure_frame
from handpose.synthetic.generator import Split, rng_of
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.scenes.cameras import HEIGHT, WIDTH, draw_cameras, slopes_of
from handpose.synthetic.scenes.draws import Draw
from handpose.synthetic.scenes.people import draw_people
from handpose.synthetic.scenes.prior import ScenePrior
from handpose.synthetic.scenes.sight import GROUPS, PERSON_OBJECT, THINGS, sight_of
from netlib.blob import Array

OTHER, HAND, PERSON = 0, 1, 2  # classes of pixels
SCENES_PER_BLOCK = 16  # scenes that share a random generator
STREAM = 2  # apart from the random numbers of hands and of places
SEEN, SEEN_PX, FARTHEST_MM = 0.3, 25, 1800.0  # a hand counts if as much of it is visible and read
READ = 0.35  # of what is visible


class Scenes(NamedTuple):
    """N frames of H x W pixels.

    Hands that are hidden, cut off or hardly read are ``doubtful``: neither right nor wrong to find.

    depth      (N, H, W) mm, 0 where nothing was read
    classes    (N, H, W) OTHER, HAND or PERSON
    which      (N, H, W) 1 or 2 at the pixels of the first or second hand, else 0
    what       (N, H, W) what is shown: an index of ``SceneGenerator.names``
    joints     (N, 2, K, 3) mm, of the skeleton of ``SceneGenerator.sampler``
    is_right   (N, 2)
    middle     (N, 2, 3) mm, the mean of each hand's joints without the wrist
    middle_px  (N, 2, 2) its column and row
    present    (N, 2) whether the hand is to be found
    doubtful   (N, 2)
    slopes     (N, H, W, 2) x / z and y / z of the rays
    """

    depth: Floats
    classes: NDArray[np.int8]
    which: NDArray[np.int8]
    what: NDArray[np.int16]
    joints: Array
    is_right: NDArray[np.bool_]
    middle: Array
    middle_px: Array
    present: NDArray[np.bool_]
    doubtful: NDArray[np.bool_]
    slopes: Floats


class SceneGenerator:
    """Draws scenes for a seed and a split, block by block.

    finer  factor of the frames' resolution, ``HEIGHT`` x ``WIDTH``
    names  of what the scenes show
    """

    def __init__(
        self, seed: int = 0, split: Split = "train", prior: ScenePrior | None = None, finer: int = 1
    ) -> None:
        self.seed, self.split, self.finer = seed, split, finer
        self.prior = prior or scene_prior.load()
        self.sampler = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR))
        self.names = (*GROUPS[:-1], *(thing.name for thing in self.prior.things.thing))

    def block(self, number: int) -> Scenes:
        """Scenes ``number * SCENES_PER_BLOCK`` and following, as a camera measures them."""
        draw = Draw(rng_of(self.seed, self.split, number, STREAM), SCENES_PER_BLOCK)
        cameras = draw_cameras(draw, self.prior.view)
        rays = cameras.rays(self.finer)
        people = draw_people(draw, self.prior, self.sampler, cameras)
        sight = sight_of(draw, self.prior, people, rays)
        focal = self.finer * cameras.focal
        clean = zip(sight.depth, sight.which > 0, focal, sight.reflects)
        # frames of the usual resolution stay those of the finder's trainings
        measure = measure_frame if self.finer == 1 else measure_fine
        depth = np.stack([measure(draw.rng, *frame) for frame in clean])
        what_of_number = np.array([*range(THINGS - 1), THINGS - 2, *(THINGS - 1 + sight.of)])
        what = what_of_number[sight.number]
        classes = np.select([sight.which > 0, what == PERSON_OBJECT], [HAND, PERSON], OTHER)
        middle = np.stack([hand.middle for hand in people.hands], axis=1)
        pixels = cameras.pixels(middle)
        seen = _pixels_of_hands(sight.which)
        read = _pixels_of_hands(np.where(depth > 0, sight.which, 0))
        is_read = (read > self.finer**2 * SEEN_PX) & (read > READ * seen)
        is_near = middle[..., 2] < FARTHEST_MM
        is_seen = (sight.share > SEEN) & _inside(pixels)
        present = people.there & is_seen & is_near & is_read
        return Scenes(
            depth=depth,
            classes=classes.astype(np.int8),
            which=sight.which,
            what=what.astype(np.int16),
            joints=np.stack([hand.joints for hand in people.hands], axis=1),
            is_right=np.stack([hand.side > 0 for hand in people.hands], axis=1),
            middle=middle,
            middle_px=self.finer * pixels,
            present=present,
            doubtful=people.there & ~present & (seen > 0),
            slopes=slopes_of(rays),
        )


def _pixels_of_hands(which: Array) -> Array:
    """The number of pixels (N, 2) of both hands, from which hand each pixel (N, H, W) is of."""
    return np.stack([(which == hand).sum((1, 2)) for hand in (1, 2)], axis=1)


def _inside(pixels: Array) -> NDArray[np.bool_]:
    """Whether pixels (..., 2) of frames of the usual resolution are within the frame's border."""
    u, v = np.moveaxis(pixels, -1, 0)
    return (u > 1) & (u < WIDTH - 2) & (v > 1) & (v < HEIGHT - 2)
