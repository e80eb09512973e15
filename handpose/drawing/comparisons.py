"""Predicted and annotated hands: of one method in two views, of several methods side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from handpose.drawing import hands, strokes
from handpose.drawing.strokes import Image
from handpose.facts.cameras import NYU, Camera
from layers.hand.skeleton import Skeleton
from netlib.blob import Array


def two_views(
    crops: Sequence[NDArray[np.floating]],
    joints: Array,
    truth: Array,
    skeleton: Skeleton,
    titles: Sequence[tuple[str, str]],
    columns: int = 6,
    centers: Array | None = None,
    camera: Camera = NYU,
    cube_mm: Sequence[float] = (),
) -> Image:
    """Every body on its crop and in space: the predicted one in colour, the annotated one in thin white and black.

    joints  (n, K, 3) half-cubes, all joints of the skeleton
    truth   (n, L, 3) annotated joints; drawn only if L is K
    titles  of the two views of each frame
    centers, camera, cube_mm  of the crops, (n, 3) px, px, mm; without them the projection is parallel
    """
    images = []
    for n, crop in enumerate(crops):
        annotated = truth[n] if len(truth[n]) == len(joints[n]) else None
        if centers is None:
            images.append(hands.overlay(crop, joints[n], skeleton, annotated, zoom=3))
        else:
            images.append(hands.overlay(crop, joints[n], skeleton, annotated, centers[n], cube_mm[n], camera, zoom=3))
        images.append(hands.view_3d(joints[n], skeleton, annotated, size=384))
    return strokes.sheet(images, columns, [title for pair in titles for title in pair])


def side_by_side(
    crops: Sequence[NDArray[np.floating]], methods: Mapping[str, Array], truth: Array, skeleton: Skeleton, unit: Array
) -> Image:
    """A frame per row and a method per column, with its error in the title; the annotated hand in white.

    methods  joints (n, K, 3) in half-cubes that each method predicts; truth (n, K, 3) those annotated
    unit     (n,) mm of a half-cube
    """
    images, titles = [], []
    for n, crop in enumerate(crops):
        for name, joints in methods.items():
            error = np.linalg.norm(joints[n] - truth[n], axis=1).mean() * unit[n]
            images.append(hands.overlay(crop, joints[n], skeleton, truth[n], zoom=2))
            titles.append(f"{name}, {error:.0f} mm")
    return strokes.sheet(images, len(methods), titles)
