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

from handpose.estimate.finder import FOCAL_PX, VOTE_MM, channels_of
from handpose.synthetic.scenes.cameras import HEIGHT, WIDTH
from handpose.synthetic.whole_scenes import SCENES_PER_BLOCK, SceneGenerator, Scenes
from netlib import TEST, Layer
from netlib.blob import Array, Blobs

IGNORE_LABEL = -1
TEST_BLOCKS = 16
LONGEST_VOTE = 2.5  # a farther surface is an error of the sensor
HEAT_STD_MM = 22.0  # deviation of the heat around a hand's middle


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
        channels, steps = (4, 1, 1, 3, 3), (1, 2, 4, 4, 4)
        for blob, count, step in zip(top, channels, steps):
            blob.reshape(SCENES_PER_BLOCK, count, HEIGHT // step, WIDTH // step)

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
    half = scenes.depth[:, ::2, ::2] > 0
    classes = np.where(half, scenes.classes[:, ::2, ::2], IGNORE_LABEL)[:, None]
    depth = scenes.depth[:, ::4, ::4]
    which = scenes.which[:, ::4, ::4]
    row, column = np.indices(depth.shape[1:])
    heat = np.zeros(depth.shape)
    for k in range(2):
        u, v = (np.round(scenes.middle_px[:, k, axis, None, None] / 4) for axis in (0, 1))
        z = np.maximum(scenes.middle[:, k, 2], 100)
        wide = np.clip(FOCAL_PX * HEAT_STD_MM / z / 4, 0.7, 4)[:, None, None]
        squares = (column - u) ** 2 + (row - v) ** 2
        near = np.exp(-squares / (2 * wide**2))
        heat = np.where(scenes.present[:, k, None, None], np.maximum(heat, near), heat)
        heat = np.where(scenes.doubtful[:, k, None, None] & (near > 0.05), IGNORE_LABEL, heat)
    forward = np.ones((*depth.shape, 1))
    rays = np.concatenate([scenes.slopes[:, ::4, ::4], forward], axis=-1)
    points = rays * depth[..., None]
    frame = np.arange(len(depth))[:, None, None]
    hand = np.maximum(which - 1, 0)
    vote = (scenes.middle[frame, hand] - points) / VOTE_MM
    is_close = np.linalg.norm(vote, axis=-1) < LONGEST_VOTE
    own = (which > 0) & (depth > 0) & is_close
    every = np.repeat(own[:, None], 3, axis=1)
    return classes, heat[:, None], np.moveaxis(vote, -1, 1) * every, every
