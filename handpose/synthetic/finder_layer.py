"""A layer of type Python that draws scenes for the finder of hands, an endless stream in the order
of their numbers.

    python_param { module: "handpose.synthetic.finder_layer" layer: "FinderScenes" param_str: "1" }

``param_str`` is the seed. The phase TEST repeats the first ``TEST_BLOCKS`` blocks of the split
"test". A snapshot holds the number of the next block, so a resumed training sees the same scenes as
one that was not interrupted.

A block has N = SCENES_PER_BLOCK scenes. Pixels that the loss ignores have I = IGNORE_LABEL.

top[0]  frame  (N, 4, H, W)        ``channels_of``
top[1]  class  (N, 1, H/2, W/2)    OTHER, HAND, PERSON, or I
top[2]  heat   (N, 1, H/4, W/4)    1 at a hand's middle, less around it, or I
top[3]  vote   (N, 3, H/4, W/4)    from the pixel's surface to the hand's middle, in
                                   VOTE_MM; 0 elsewhere
top[4]  own    (N, 3, H/4, W/4)    1 at the pixels that vote, else 0
"""

from __future__ import annotations

from typing import Any

import numpy as np

from handpose.estimate.finder import VOTE_MM, channels_of
from handpose.frames.cameras import FINDER_FOCAL_PX
from handpose.synthetic.scenes.cameras import HEIGHT, WIDTH
from handpose.synthetic.whole_scenes import SCENES_PER_BLOCK, SceneGenerator, Scenes
from netlib import TEST, Layer
from netlib.blob import Array, Blobs

IGNORE_LABEL = -1
TEST_BLOCKS = 16
CLASS_STEP, HEAT_STEP = 2, 4  # px of the frame for a pixel of the classes, and of the other tops
CHANNELS, STEPS = (4, 1, 1, 3, 3), (1, CLASS_STEP, HEAT_STEP, HEAT_STEP, HEAT_STEP)  # of the tops
MAX_VOTE = 2.5  # a farther surface is an error of the sensor
HEAT_STD_MM = 22.0  # standard deviation of the heat around a hand's middle, ...
MIN_STD_PX, MAX_STD_PX = 0.7, 4.0  # ... and its bounds in pixels of the heat
MIN_MIDDLE_MM = 100.0  # of the middles of hands
MIN_HEAT = 0.05  # around a doubtful hand, pixels with less are not ignored


class FinderScenes(Layer):
    """Scenes and what the finder is to say about them."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the seed. Raises LayerError."""
        if len(top) != 5:
            raise self.fail(f"has {len(top)} tops, expected 5: frame, class, heat, vote, own")
        if not self.param_str.isdecimal():
            raise self.fail(
                f"param_str {self.param_str!r}, expected a seed, a whole number from 0 on"
            )
        self.generator = SceneGenerator(
            int(self.param_str), "test" if self.phase == TEST else "train"
        )
        self.number = 0

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Shape the tops for a block of scenes."""
        for blob, channels, step in zip(top, CHANNELS, STEPS):
            blob.reshape(SCENES_PER_BLOCK, channels, HEIGHT // step, WIDTH // step)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Draw the next block."""
        scenes = self.generator.block(self.number)
        for blob, values in zip(top, (channels_of(scenes.depth), *targets_of(scenes))):
            blob.data[...] = values
        self.number += 1
        if self.phase == TEST:
            self.number %= TEST_BLOCKS

    def state(self) -> dict[str, Any]:
        """The number of the next block."""
        return {"number": self.number}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue with the block of a state; with the first one after a layer of another type."""
        self.number = int(state.get("number", 0))


def targets_of(scenes: Scenes) -> tuple[Array, Array, Array, Array]:
    """The class, heat, vote and own of the layer's tops."""
    labels = np.where(scenes.depth > 0, scenes.classes, IGNORE_LABEL)
    classes = labels[:, None, ::CLASS_STEP, ::CLASS_STEP]
    return classes, _heat(scenes), *_votes(scenes)


def _heat(scenes: Scenes) -> Array:
    """The top heat."""
    row, column = np.indices((HEIGHT // HEAT_STEP, WIDTH // HEAT_STEP))
    heat = np.zeros((len(scenes.depth), *row.shape))
    for k in range(2):
        u, v = np.round(scenes.middle_px[:, k].T / HEAT_STEP)[..., None, None]
        z = np.maximum(scenes.middle[:, k, 2], MIN_MIDDLE_MM)
        std_px = np.clip(FINDER_FOCAL_PX * HEAT_STD_MM / z / HEAT_STEP, MIN_STD_PX, MAX_STD_PX)
        squares = (column - u) ** 2 + (row - v) ** 2
        own = np.exp(-squares / (2 * std_px[:, None, None] ** 2))
        heat = np.where(scenes.present[:, k, None, None], np.maximum(heat, own), heat)
        ignored = scenes.doubtful[:, k, None, None] & (own > MIN_HEAT)
        heat = np.where(ignored, IGNORE_LABEL, heat)
    return heat[:, None]


def _votes(scenes: Scenes) -> tuple[Array, Array]:
    """The tops vote and own."""
    depth, which, slopes = (
        values[:, ::HEAT_STEP, ::HEAT_STEP]
        for values in (scenes.depth, scenes.which, scenes.slopes)
    )
    rays = np.concatenate([slopes, np.ones((*depth.shape, 1))], axis=-1)
    points = rays * depth[..., None]
    frame = np.arange(len(depth))[:, None, None]
    hand = np.maximum(which - 1, 0)
    vote = (scenes.middle[frame, hand] - points) / VOTE_MM
    is_close = np.linalg.norm(vote, axis=-1) < MAX_VOTE
    own = np.repeat(((which > 0) & (depth > 0) & is_close)[:, None], 3, axis=1)
    return np.moveaxis(vote, -1, 1) * own, own
