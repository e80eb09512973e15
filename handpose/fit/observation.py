"""Observations of N bodies: surface points, outline, and the free space in front of the surface.

Everything is in mm from the crop's centre, in camera axes (x right, y up, z away).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import Camera, Floats
from handpose.frames.crops import FAR_FACE, crop_scale, window
from netlib.blob import Array
from netlib.errors import DataError

_CROSS = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class Observation:
    """The observations of N frames.

    points   (N, 3, P) on the surface, from the rows of the crop; 0 where there are fewer
    rays     (N, 3, P) unit vectors from the camera through them
    known    (N, P) the weights of the points, 1 without any, 0 where there are fewer
    frame    (N,) index of the crop, of F
    outside  (F, S, S) distance of a pixel from the silhouette, negative inside
    nearest  (F, S, S) least depth in the 3 x 3 pixels about each
    center   (N, 3) the crop's centre in camera axes
    half     (N,) half the cube's edge
    offset, factor  (N, 2) column and row of the crop: offset + factor * (x, y) / z
    """

    points: Floats
    rays: Floats
    known: Floats
    frame: NDArray[np.int_]
    outside: Floats
    nearest: Floats
    center: Floats
    half: Floats
    offset: Floats
    factor: Floats

    def __len__(self) -> int:
        return len(self.center)

    def take(self, rows: slice | NDArray[np.int_]) -> Observation:
        """Some of the frames, with repetition. The crops themselves are not copied."""
        return Observation(
            **{
                name: values if name in ("outside", "nearest") else values[rows]
                for name, values in vars(self).items()
            }
        )

    @property
    def is_weighted(self) -> NDArray[np.bool_]:
        """True (N,) for frames whose points are not all alike."""
        return np.asarray(((self.known > 0) & (self.known < 1)).any(axis=1))

    def unweighted(self) -> Observation:
        """The observations with points that are all alike."""
        return replace(self, known=(self.known > 0).astype(np.float32))

    def thinned(self, every: int) -> Observation:
        """The observations with every ``every``-th point."""
        few = {
            name: np.ascontiguousarray(getattr(self, name)[..., ::every])
            for name in ("points", "rays", "known")
        }
        return Observation(**(vars(self) | few))


@dataclass(frozen=True)
class HandCrops:
    """Crops of N right hands, or of left ones in the views in which these are right hands.

    crops       (N, S, S) in [-1, 1]
    center_uvd  (N, 3) px, px, mm: the crops' centres
    cameras     of the frames, one or N that differ in the principal point alone
    cube_mm     edge of the crops' cubes
    shown       (N, S, S) instead of the crops for the network, or None
    weight      (N, S, S) of the pixels in a fit; None: all are alike
    """

    crops: NDArray[np.floating]
    center_uvd: Array
    cameras: Camera | Sequence[Camera]
    cube_mm: float
    shown: NDArray[np.floating] | None = None
    weight: NDArray[np.floating] | None = None

    def __len__(self) -> int:
        return len(self.crops)

    def take(self, rows: slice) -> HandCrops:
        """Some of the crops."""
        cameras = self.cameras
        if not isinstance(cameras, Camera):
            cameras = cameras[rows]
        shown, weight = (
            None if images is None else images[rows] for images in (self.shown, self.weight)
        )
        crops, center_uvd = self.crops[rows], self.center_uvd[rows]
        return HandCrops(crops, center_uvd, cameras, self.cube_mm, shown, weight)

    @property
    def network_input(self) -> NDArray[np.floating]:
        """(N, S, S): what the network is shown."""
        return self.crops if self.shown is None else self.shown


def observe(hands: HandCrops, points: int, thin_px: float) -> Observation:
    """The observations of crops. Raises DataError.

    points   number of points that are sampled in each
    thin_px  as in ``FitSettings``
    """
    crops = hands.crops
    if crops.ndim != 3 or crops.shape[1] != crops.shape[2]:
        raise DataError(f"crops of shape {crops.shape}, expected (N, size, size)")
    N, S, _ = crops.shape
    uvd = np.asarray(hands.center_uvd, dtype=np.float64)
    cameras = [hands.cameras] * N if isinstance(hands.cameras, Camera) else hands.cameras
    camera = cameras[0]
    middle = np.array([(own.u0, own.v0) for own in cameras])
    center = np.stack([own.unproject(at) for own, at in zip(cameras, uvd)])
    half = np.full(N, hands.cube_mm / 2)
    picked = window(uvd, 2 * half, camera, S)
    first, scale = crop_scale(uvd, 2 * half, camera, S)
    x = ((picked.columns - middle[:, :1]) / camera.fx).astype(np.float32)
    y = ((middle[:, 1:] - picked.rows) / camera.fy).astype(np.float32)
    inside = (picked.columns >= 0)[:, None, :] & (picked.rows >= 0)[:, :, None]
    inside &= np.abs(crops) < FAR_FACE

    surface, rays = np.zeros((2, N, 3, points), np.float32)
    known = np.zeros((N, points), np.float32)
    outside, nearest = np.empty((2, N, S, S), np.float32)
    for n, crop in enumerate(crops):
        outline = _outside(crop)
        seen = _sampled(np.flatnonzero(inside[n]), outline, points, thin_px)
        row, column = np.divmod(seen, S)
        z = crop.reshape(-1)[seen] * half[n] + center[n, 2]
        at = np.stack([x[n, column] * z, y[n, row] * z, z])
        surface[n, :, : len(seen)] = at - center[n][:, None]
        rays[n, :, : len(seen)] = at / np.linalg.norm(at, axis=0)
        known[n, : len(seen)] = 1 if hands.weight is None else hands.weight[n].reshape(-1)[seen]
        outside[n] = outline * np.float32(2 * half[n] / S)
        nearest[n] = cv2.erode(crop.astype(np.float32), _CROSS) * np.float32(half[n])
    focal = np.array([camera.fx, camera.fy])
    offset, factor = first + scale * middle, scale * focal * (1, -1)
    of_crops = (values.astype(np.float32) for values in (center, half, offset, factor))
    return Observation(surface, rays, known, np.arange(N), outside, nearest, *of_crops)


def _sampled(
    pixels: NDArray[np.int_], outline: Floats, points: int, thin_px: float
) -> NDArray[np.int_]:
    """At most ``points`` of these pixels of a crop, denser near the outline, whose distances (S, S)
    are given.
    """
    if len(pixels) <= points:
        return pixels
    share = np.cumsum(1 / (thin_px + np.maximum(-outline.reshape(-1)[pixels], 0)))
    places = (np.arange(points) + 0.5) * (share[-1] / points)
    return pixels[np.searchsorted(share, places)]


def _outside(crop: NDArray[np.floating]) -> Floats:
    """Distance (S, S) in pixels of each pixel's middle from the silhouette's edge, negative inside.

    Single pixels without a reading are closed first. The silhouette is assumed to continue beyond
    the crop's edge.
    """
    solid = cv2.morphologyEx((crop < FAR_FACE).astype(np.uint8), cv2.MORPH_CLOSE, _CROSS)
    out = cv2.distanceTransform(1 - solid, cv2.DIST_L2, cv2.DIST_MASK_5)
    bordered = cv2.copyMakeBorder(solid, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    within = cv2.distanceTransform(bordered, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    far = np.float32(len(crop))  # a crop without a silhouette, or all of it, has no distance
    # the edge is half a pixel from the middles on both sides
    from_inside, from_outside = 0.5 - np.minimum(within, far), np.minimum(out, far) - 0.5
    return np.asarray(np.where(solid > 0, from_inside, from_outside), np.float32)
