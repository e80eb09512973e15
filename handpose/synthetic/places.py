"""Crops of places in synthetic scenes, with and without a hand: training data of a locator.

The labels are whether a hand is near, and where its middle is (``handpose.estimate.locator``).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import KINECT2, SR305
from handpose.frames.places import BEHIND_MM, CUBE_MM, SIZE, VOXEL_MM, place_crops, surface_places
from handpose.synthetic.generator import BLOCK, VERSION, Split, View, body_hash, check_source, numbers_of
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.prior_file import RangeParameter
from handpose.synthetic.recipes import any_roll
from handpose.synthetic.scenes import draw_scenes, prior_of
from handpose.synthetic.sensor import CODED_LIGHT, TIME_OF_FLIGHT
from handpose.synthetic.surface_prior import PERSON_SURFACE
from netlib.blob import Array

WITHIN_MM, BEYOND_MM = 100.0, 130.0  # a hand is near below, not near above; between them the place has no label
UNKNOWN = -1.0
PER_SCENE = 16  # places per scene
REFINED, WITH_HAND = 4, 4  # numbers of places moved as by a locator, and of others with a hand
REFINED_MM, JITTER_MM = 25.0, 15.0  # deviations
PLACES_VERSION = 1  # increase if the code here, in scenes.py or in handpose/frames/places.py changes places
VIEWS = ((View(), (400.0, 1200.0)), (View(KINECT2, TIME_OF_FLIGHT), (450.0, 1500.0)),
         (View(SR305, CODED_LIGHT), (250.0, 900.0)))


@dataclass(frozen=True)
class PlaceRows:
    """n places; the names are those of the data sets in the files.

    depth   (n, 1, SIZE, SIZE) crops in [-1, 1]
    hand    (n,) 1, 0, or UNKNOWN
    offset  (n, 3) from the crop's centre to the hand's, in half-cubes; 0 without a hand
    near    (n, 3) 1 with a hand, else 0
    index   (n,) number of the place in its split
    """

    depth: NDArray[np.float32]
    hand: NDArray[np.float32]
    offset: NDArray[np.float32]
    near: NDArray[np.float32]
    index: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.index)

    def arrays(self) -> dict[str, Array]:
        """All arrays by name, in the order of the files."""
        return dict(vars(self))

    def rows(self, rows: slice) -> PlaceRows:
        """Some of the places."""
        return PlaceRows(**{name: array[rows] for name, array in vars(self).items()})


class PlaceGenerator:
    """Draws places, block by block, as ``Generator`` draws hands."""

    description = (
        "Places of rendered scenes, with a hand (1), without (0), or neither (-1); crops 64 x 64 of 400 mm in [-1, 1], "
        "the offset of the hand's middle in half-cubes from the crop's (camera axes, x right, y up, z away)."
    )

    def __init__(self, seed: int = 0, split: Split = "train") -> None:
        check_source(seed, split)
        self.seed, self.split = seed, split

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.seed, self.split)

    def block(self, number: int) -> PlaceRows:
        """Places ``number * BLOCK`` and following; the result depends on the number only."""
        rng = numbers_of(self.seed, self.split, number, 1)  # 1: another stream than that of the hands
        scenes = BLOCK // PER_SCENE
        parts = [self._of_a_scene(rng, scene) for scene in range(number * scenes, (number + 1) * scenes)]
        depth, middle = (np.concatenate(arrays) for arrays in zip(*parts))
        apart = np.linalg.norm(middle, axis=1)
        mirrored = rng.random(len(depth)) < 0.5
        depth[mirrored] = depth[mirrored][:, :, ::-1]
        middle[mirrored, 0] *= -1
        near = np.repeat((apart < WITHIN_MM)[:, None], 3, axis=1)
        return PlaceRows(
            depth=depth[:, None],
            hand=np.select([apart < WITHIN_MM, apart > BEYOND_MM], [1.0, 0.0], UNKNOWN).astype(np.float32),
            offset=np.where(near, middle / (CUBE_MM / 2), 0).astype(np.float32),
            near=near.astype(np.float32),
            index=np.arange(number * BLOCK, (number + 1) * BLOCK),
        )

    def columns(self) -> dict[str, Array]:
        """Arrays without rows, of the shapes and types of the places'."""
        none = np.zeros((0, 3), np.float32)
        return PlaceRows(
            np.zeros((0, 1, SIZE, SIZE), np.float32), none[:, 0], none, none, np.zeros(0, np.int64)
        ).arrays()

    def made_from(self) -> dict[str, object]:
        """Everything that the places depend on, as JSON values."""
        return {
            "version": VERSION,
            "places": PLACES_VERSION,
            "seed": self.seed,
            "split": self.split,
            "views": [
                [asdict(view.camera), asdict(view.sensor) if view.sensor else None, *depth] for view, depth in VIEWS
            ],
            "body": body_hash(BodySampler(any_roll()).skeleton),
            "prior": asdict(any_roll()),
            "flesh": asdict(PERSON_SURFACE),
            "crop": [CUBE_MM, SIZE, VOXEL_MM, BEHIND_MM],
            "drawn": [WITHIN_MM, BEYOND_MM, PER_SCENE, REFINED, WITH_HAND, REFINED_MM, JITTER_MM],
        }

    def _of_a_scene(self, rng: np.random.Generator, number: int) -> tuple[NDArray[np.float32], Array]:
        """Crops (PER_SCENE, SIZE, SIZE), and the positions (PER_SCENE, 3) of the hand's middle in mm from theirs."""
        view, depth = VIEWS[int(rng.integers(len(VIEWS)))]
        scenes = draw_scenes(rng, 1, view.camera, view.sensor, prior_of(RangeParameter(*depth)), first=number)
        image, hand = scenes.depth[0], scenes.center[0]
        places = surface_places(image, view.camera)
        places = rng.permutation(places + rng.normal(0, JITTER_MM, places.shape))
        apart = np.linalg.norm(places - hand, axis=1)
        refined = hand + rng.normal(0, REFINED_MM, (REFINED, 3))
        chosen = np.concatenate([refined, places[apart < WITHIN_MM][:WITH_HAND], places[apart >= WITHIN_MM]])
        crops, kept = place_crops(image, chosen, view.camera)
        some = np.arange(PER_SCENE) % len(kept)  # with few places some are repeated
        return crops[some], (hand - kept)[some]
