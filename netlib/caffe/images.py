"""Images as inputs of a net, with the arguments of OpenCV's ``cv2.dnn.blobFromImage``.

net.setInput(cv2.dnn.blobFromImage(image, 1 / 127.5, (224, 224), (127.5, 127.5, 127.5)))     # with cv2.dnn
net.forward(data=blob_from_image(image, 1 / 127.5, (224, 224), (127.5, 127.5, 127.5)))       # with a Net

OpenCV computes the values, those of uint16 as of float32.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from netlib.blob import Array
from netlib.caffe.io import ShapeError

TYPES = (np.uint8, np.uint16, np.float32)


def blob_from_image(
    image: Array,
    scalefactor: float = 1.0,
    size: Sequence[int] | None = None,
    mean: ArrayLike = (),
    swapRB: bool = False,
    crop: bool = False,
) -> NDArray[np.float32]:
    """Convert one image to an input (1, C, H, W); the arguments are those of ``blob_from_images``."""
    return blob_from_images([image], scalefactor, size, mean, swapRB, crop)


def blob_from_images(
    images: Sequence[Array],
    scalefactor: float = 1.0,
    size: Sequence[int] | None = None,
    mean: ArrayLike = (),
    swapRB: bool = False,
    crop: bool = False,
) -> NDArray[np.float32]:
    """Convert images to an input (N, C, H, W): ``(image - mean) * scalefactor``, resized by bilinear interpolation.

    images       (H, W), (H, W, 1), (H, W, 3) or (H, W, 4) each, of uint8, uint16 or float32; blue first, as OpenCV
                 reads them
    size         width and height of the result in px; None or (0, 0) for those of the first image
    mean         one number per channel of the result, so red first with ``swapRB``; empty for 0. Further numbers are
                 ignored, as in OpenCV
    swapRB       exchange the first and the third channel
    crop         keep the aspect ratio: scale the image until it covers ``size``, and cut out its centre. Otherwise it
                 is stretched

    Raises ShapeError.
    """
    if isinstance(images, np.ndarray) and images.ndim < 4 and images.dtype != object:
        raise ShapeError(f"blob_from_images takes a list of images, found an array of shape {images.shape}; "
                         "blob_from_image takes one image")
    if not len(images):
        raise ShapeError("blob_from_images takes at least one image, found none")
    planes = [_planes(image) for image in images]
    if len({each.shape[2] for each in planes}) > 1:
        raise ShapeError(f"blob_from_images takes images with the same number of channels, found "
                         f"{[each.shape[2] for each in planes]}")
    channels = planes[0].shape[2]
    means = np.atleast_1d(np.asarray(mean, np.float64))
    if means.ndim != 1 or 0 < len(means) < channels:
        raise ShapeError(f"the mean has shape {means.shape}; expected one number for each of {channels} channels")
    shape = (0, 0) if size is None or tuple(size) == (0, 0) else _size(size)
    center = means[:4].tolist() or (0, 0, 0, 0)
    blob: Any = cv2.dnn.blobFromImages(planes, scalefactor, shape, center, swapRB, crop)
    return np.ascontiguousarray(blob, np.float32)


def _planes(image: Array) -> Array:
    """Check an image; returns (H, W, C)."""
    image = np.asarray(image)
    if image.ndim == 2:
        image = image[:, :, None]
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4) or not image.size:
        raise ShapeError(f"found an image of shape {image.shape}; expected (H, W), or (H, W, C) with 1, 3 or 4 "
                         "channels. cv2.imread returns None for a file that it cannot read")
    if image.dtype not in TYPES:
        raise ShapeError(f"found an image of {image.dtype}; expected uint8, uint16 or float32")
    # A copy, because OpenCV 4 scales float32 images in place.
    return image.astype(np.uint8 if image.dtype == np.uint8 else np.float32, order="C")


def _size(size: Sequence[int]) -> tuple[int, int]:
    """Check a width and a height."""
    numbers = np.asarray(size)
    if numbers.shape != (2,) or numbers.dtype.kind not in "iu" or numbers.min() < 1:
        raise ShapeError(f"size is {size}; expected a width and a height of at least 1 px")
    return int(numbers[0]), int(numbers[1])
