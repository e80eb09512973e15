"""Preprocessing shared by all layers that read images: ``transform_param { ... }``.

An image x is (C, H, W), bytes or floats. The result is

    y = scale (x - mean)

then cropped to ``crop_size`` x ``crop_size`` and mirrored left to right at random. The mean
is an image of the size of x, or one number per channel, or one for all. The crop is random in
phase TRAIN, central in TEST (rounded to the top and left); images are mirrored in both
phases, as in Caffe.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Array
from netlib.errors import LayerError
from netlib.files.paths import find
from netlib.layer import TRAIN, Layer, warn_of_ignored
from netlib.proto import schema
from netlib.proto.binaryproto import read_blob
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class TransformationParameter:
    """The ``transform_param { ... }`` block."""

    scale: float = numbered(1, 1.0)  # factor applied after the mean is subtracted
    mirror: bool = numbered(2, False)  # mirror half of the images, at random
    crop_size: UInt = numbered(3, 0)  # height and width of the result; 0: no crop
    mean_file: str | None = numbered(4, None)  # .binaryproto file with (1, C, H, W)
    mean_value: tuple[float, ...] = numbered(5, ())  # alternative: one per channel, or one for all
    force_color: bool = numbered(6, False)  # decode images in databases with three channels
    force_gray: bool = numbered(7, False)  # decode images in databases with one channel


class Transformer:
    """Transforms the images of one layer, with the layer's random generator.

    param  the options
    """

    def __init__(self, layer: Layer) -> None:
        self.layer = layer
        self.param: TransformationParameter = layer.read_block(
            "transform_param", TransformationParameter
        )
        self.mean = self._read_mean()
        if self.param.force_color and self.param.force_gray:
            raise self.fail("force_color and force_gray cannot both be set", "force_gray")

    def _read_mean(self) -> Array:
        """Read the mean: (C, H, W), (C, 1, 1) or (1, 1, 1)."""
        p, dtype = self.param, self.layer.dtype
        if p.mean_file is None:
            return np.array(p.mean_value or (0,), dtype).reshape(-1, 1, 1)
        if p.mean_value:
            raise self.fail("mean_file and mean_value cannot both be given", "mean_value")
        mean = read_blob(find(p.mean_file, self.layer.source))
        if mean.ndim != 4 or len(mean) < 1:
            raise self.fail(
                f"mean_file {p.mean_file!r} has shape {mean.shape}, expected (1, C, H, W)",
                "mean_file",
            )
        return mean[0].astype(dtype)

    def fail(self, message: str, field: str) -> LayerError:
        """Return an error with the position of a field of transform_param."""
        return LayerError(
            f"{schema.position_of(self.param, field)}: error: layer {self.layer.name!r}: {message}"
        )

    @property
    def color(self) -> bool | None:
        """How to decode images in databases: True in colour, False in grey, None unchanged."""
        return True if self.param.force_color else False if self.param.force_gray else None

    def shape(self, image: Array, what: str) -> tuple[int, int, int]:
        """Shape of the result for an image; ``what`` names it in messages. Raises LayerError."""
        (C, H, W), size = image.shape, self.param.crop_size
        if min(H, W) < size:
            raise self.fail(
                f"{what}: the image (C, H, W) {image.shape} is smaller than crop_size {size}",
                "crop_size",
            )
        return (C, size, size) if size else (C, H, W)

    def transform(self, image: Array, y: Array, what: str) -> None:
        """Write the transformed image to ``y``. Raises LayerError if the shapes differ."""
        p, train, rng = self.param, self.layer.phase == TRAIN, self.layer.rng
        C, H, W = self.shape(image, what)
        if y.shape != (C, H, W):
            raise self.fail(
                f"{what}: the image (C, H, W) {image.shape} gives {(C, H, W)}, the first of its batch "
                f"{y.shape}; expected the same number of channels, and without crop_size the same size",
                "crop_size",
            )
        self._check_mean(image, what)
        mirror = p.mirror and rng.integers(2) == 1
        top, left = (image.shape[1] - H) // 2, (image.shape[2] - W) // 2
        if p.crop_size and train:
            top = int(rng.integers(image.shape[1] - H + 1))
            left = int(rng.integers(image.shape[2] - W + 1))
        crop = np.s_[:, top : top + H, left : left + W]
        # the mean at the position before cropping
        mean = np.broadcast_to(self.mean, image.shape)[crop]
        result = (image[crop].astype(y.dtype) - mean) * y.dtype.type(p.scale)
        y[...] = result[:, :, ::-1] if mirror else result

    def _check_mean(self, image: Array, what: str) -> None:
        p = self.param
        if p.mean_file is not None and self.mean.shape != image.shape:
            raise self.fail(
                f"{what}: the image (C, H, W) is {image.shape}, mean_file {p.mean_file!r} "
                f"{self.mean.shape}; expected equal shapes before cropping",
                "mean_file",
            )
        if len(p.mean_value) not in (0, 1, len(image)):
            raise self.fail(
                f"{what}: {len(image)} channels, but {len(p.mean_value)} mean_value; expected "
                "one for all, or one per channel",
                "mean_value",
            )


def warn_of_misplaced(layer: Layer, *names: str) -> None:
    """Warn of options in a layer's own block that Caffe now reads only from transform_param."""
    warn_of_ignored(layer, *names, advice="; write it in transform_param")
