"""HandAugment: rotate, scale and shift depth crops and their joints at random during training.

bottom[0]  depth  (N, 1, S, S)  crops in [-1, 1], background 1
bottom[1]  joint  (N, 3 K)      x y z of each joint, in half-cubes from the crop centre; x
                                right, y up, z away
top[0], top[1]    same shapes, may be the same blobs

TRAIN, with a random angle a (counter-clockwise), factor s, shift (u right, v down) and
step d per item:

    a pixel at (c, r) from the centre moves to  s (c cos a + r sin a, r cos a - c sin a) + (u, v)
    its depth z becomes                         s z + d, clipped to [-1, 1], except background
    a joint (x, y, z) moves to                  s (x cos a - y sin a, x sin a + y cos a,
                                                z) + (u', -v', d)

with u' = u / (S/2), v' = v / (S/2), because a half-cube has S/2 pixels. Joints are clipped to
[-1, 1], as in the data. The factor scales the hand in all three directions, which is equivalent to
a smaller cube around it. Pixels are sampled by nearest neighbour, because averaging depths across
an edge gives points in free space. Beyond the crop its border is repeated, so that an arm
continues. The projection is treated as orthographic; over the depth of a hand, perspective would
change the shift by up to a fifth, less than a pixel.

TEST  the tops are copies of the bottoms. There is no gradient: place the layer directly after
      the data layer.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import TRAIN, Layer
from netlib.proto.schema import numbered

# Offset in px of a crop's centre from column and row S/2, because the crop's corner and the sampled
# pixel are both rounded down. On the mean of NYU's crops it is 0.765 in columns and 0.909 in rows;
# an error of 0.25 px is below the noise.
CENTRE_OFFSET = 0.75


@dataclass(frozen=True)
class HandAugmentParameter:
    """The ``hand_augment_param { ... }`` block: maximum changes, each drawn uniformly from
    both directions.
    """

    rotation: float = numbered(1, 0.0)  # degrees
    scale: float = numbered(2, 0.0)  # factors from 1 - scale to 1 + scale
    shift: float = numbered(3, 0.0)  # px of the crop, horizontally and vertically
    depth: float = numbered(4, 0.0)  # half-cubes: 9 mm is 0.06 in the 300 mm cube


class HandAugment(Layer):
    """Random transformations of crops and joints that give valid new examples."""

    param: HandAugmentParameter
    bottoms = tops = (2, 2)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        for name, limit in (("rotation", 180.0), ("scale", 0.9), ("shift", np.inf), ("depth", 2.0)):
            value = getattr(p, name)
            if not 0 <= value <= limit:
                raise self.fail(f"{name} {value:g} must be from 0 to {limit:g}", name)
        self.warps = max(p.rotation, p.scale, p.shift) > 0
        self.active = self.phase == TRAIN and (self.warps or p.depth > 0)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        depth, joint = bottom
        N, S = depth.num, depth.width
        if len(depth.shape) != 4 or depth.channels != 1 or depth.height != S:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {depth.shape}, expected crops (N, 1, S, S)"
            )
        if joint.num != N or joint.count % max(3 * N, 1):
            raise self.fail(
                f"bottom {self.spec.bottom[1]!r} has shape {joint.shape}, expected joints ({N}, 3 K)"
            )
        for x, y in zip(bottom, top):
            y.reshape(x.shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        if not self.active:
            for x, y in zip(bottom, top):
                if y is not x:
                    y.data[...] = x.data
            return
        p = self.param
        N, _, S, _ = bottom[0].shape
        limits = np.array([np.deg2rad(p.rotation), p.scale, p.shift, p.shift, p.depth])
        a, s, u, v, d = self.rng.uniform(-1, 1, (5, N)) * limits[:, None]
        s += 1
        cos, sin = np.cos(a), np.sin(a)
        rotation = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)  # of (column, row)
        shift = np.stack([u, v], axis=1)
        self.move_joints(bottom[1].data, top[1].data, rotation, s, shift / (S / 2), d)
        source = _old_from_new(rotation, s, shift, S)
        self.move_crops(bottom[0].data[:, 0], top[0].data[:, 0], source, s, d)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if any(propagate_down):
            raise self.fail("has no gradient; place it directly after the data layer")

    def allow_force_backward(self, bottom_index: int) -> bool:
        return False

    def move_joints(
        self, x: Array, y: Array, rotation: Array, s: Array, shift: Array, d: Array
    ) -> None:
        """Write the transformed joints (N, 3 K) to y; ``shift`` (N, 2) is (u', v')."""
        joints = x.reshape(len(s), -1, 3).astype(np.float64)
        plane = joints[..., :2] * (1, -1) @ rotation.transpose(0, 2, 1)  # (column, row)
        rotated = np.concatenate([plane * (1, -1), joints[..., 2:]], axis=2)
        step = np.stack([shift[:, 0], -shift[:, 1], d], axis=1)
        moved = rotated * s[:, None, None] + step[:, None]
        y[...] = np.clip(moved, -1, 1).reshape(y.shape)

    def move_crops(self, x: Array, y: Array, source: Array, s: Array, d: Array) -> None:
        """Write the transformed crops (N, S, S) to y: sampled by the matrices ``source`` (N, 2, 3)
        of ``_old_from_new``, with depths s z + d.
        """
        S = x.shape[-1]
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        warped = x.copy()
        if self.warps:
            for n in range(len(x)):
                cv2.warpAffine(x[n], source[n], (S, S), warped[n], flags, cv2.BORDER_REPLICATE)
        factor, step = s.astype(self.dtype), d.astype(self.dtype)
        depth = warped * factor[:, None, None] + step[:, None, None]
        y[...] = np.where(warped >= 1, 1, np.clip(depth, -1, 1))


def _old_from_new(rotation: Array, s: Array, shift: Array, S: int) -> Array:
    """Matrices (N, 2, 3) from a pixel (column, row, 1) of the new crop to the pixel of the
    old one that it shows.
    """
    inverse = rotation.transpose(0, 2, 1) / s[:, None, None]
    centre = np.full(2, S / 2 + CENTRE_OFFSET)
    offset = centre - np.einsum("nij,nj->ni", inverse, centre + shift)
    return np.concatenate([inverse, offset[:, :, None]], axis=2)
