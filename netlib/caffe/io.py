"""caffe.io: conversion of arrays to and from Caffe's messages, and preprocessing of images.

Transformer, load_image, resize_image and oversample compute the same values as pycaffe's, with
SciPy instead of scikit-image.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from netlib import files
from netlib.blob import Array
from netlib.caffe import proto
from netlib.errors import DataError, NetlibError, did_you_mean
from netlib.files import pictures

Size = Sequence[int] | Array  # height and width
GRAY = (0.2125, 0.7154, 0.0721)  # scikit-image's weights of red, green, blue


def __getattr__(name: str) -> Any:
    """Names that pycaffe's module imports, and scripts use from it, imported at their first use.

    Raises NetlibError for those of scikit-image if it is not installed.
    """
    if name == "caffe_pb2":
        return proto.caffe_pb2
    if name == "zoom":
        return scipy.ndimage.zoom
    if name in ("skimage", "resize"):
        try:
            import skimage.io
            from skimage.transform import resize
        except ImportError:
            raise NetlibError(
                f"caffe.io.{name} is of scikit-image, which is missing: pip install scikit-image"
            ) from None
        return resize if name == "resize" else skimage
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


class ShapeError(DataError, ValueError):
    """An array of the wrong shape; also a ValueError, which scripts written for pycaffe catch."""


def plain(numbers: Sequence[float] | Array) -> tuple[float, ...]:
    """Convert numbers, also NumPy's, for messages: ``(2, 3)``."""
    return tuple(np.asarray(numbers).tolist())


# ----------------------------------------------------------------------------------------- messages


def blobproto_to_array(blob: Any, return_diff: bool = False) -> NDArray[np.float64]:
    """Convert a BlobProto, or its gradients, to an array.

    Raises ShapeError if values do not match the shape.
    """
    single, double = (blob.diff, blob.double_diff) if return_diff else (blob.data, blob.double_data)
    values = np.array(double if len(double) else single, np.float64)
    legacy = ("num", "channels", "height", "width")
    shape = (
        [getattr(blob, name) for name in legacy]
        if any(map(blob.HasField, legacy))
        else blob.shape.dim
    )
    return _shaped(values, tuple(shape), "a BlobProto")


def array_to_blobproto(arr: Array, diff: Array | None = None) -> Any:
    """Convert an array, and optionally gradients of the same shape, to a BlobProto."""
    blob = proto.caffe_pb2.BlobProto()
    blob.shape.dim.extend(arr.shape)
    blob.data.extend(arr.astype(float).ravel())
    if diff is not None:
        blob.diff.extend(diff.astype(float).ravel())
    return blob


def arraylist_to_blobprotovector_str(arraylist: Iterable[Array]) -> bytes:
    """Encode arrays as the bytes of a BlobProtoVector."""
    vector = proto.caffe_pb2.BlobProtoVector()
    vector.blobs.extend([array_to_blobproto(array) for array in arraylist])
    return vector.SerializeToString()


def blobprotovector_str_to_arraylist(str: bytes) -> list[NDArray[np.float64]]:
    """Decode the arrays in the bytes of a BlobProtoVector. Raises DecodeError or ShapeError."""
    vector = proto.caffe_pb2.BlobProtoVector()
    vector.ParseFromString(str)
    return [blobproto_to_array(blob) for blob in vector.blobs]


def array_to_datum(arr: Array, label: int | None = None) -> Any:
    """Convert an array (C, H, W) to a Datum: uint8 as bytes, other types as floats.

    Raises ShapeError.
    """
    if arr.ndim != 3:
        raise ShapeError(
            f"Incorrect array shape: a Datum takes (channels, height, width), found {arr.shape}"
        )
    datum = proto.caffe_pb2.Datum()
    datum.channels, datum.height, datum.width = arr.shape
    if arr.dtype == np.uint8:
        datum.data = arr.tobytes()
    else:
        datum.float_data.extend(arr.astype(float).ravel())
    if label is not None:
        datum.label = label
    return datum


def datum_to_array(datum: Any) -> Array:
    """Convert a Datum to an array (C, H, W) of uint8 or float64; its label is ``datum.label``.

    Raises ShapeError.
    """
    if datum.encoded:
        raise ShapeError(
            "the Datum holds an encoded image; decode its data, for example with OpenCV"
        )
    values: Array = np.array(datum.float_data, np.float64)
    if len(datum.data):
        values = np.frombuffer(datum.data, np.uint8).copy()
    return _shaped(values, (datum.channels, datum.height, datum.width), "a Datum")


def _shaped(values: Array, shape: tuple[int, ...], what: str) -> Array:
    if min(shape, default=0) < 0 or math.prod(shape) != values.size:
        raise ShapeError(f"{what} has shape {shape}, but {values.size} values")
    return values.reshape(shape)


# ------------------------------------------------------------------------------------ preprocessing


class Transformer:
    """Converts images to inputs of a net, and inputs to images.

    ``inputs`` maps each input blob to its shape: ``{"data": net.blobs["data"].data.shape}``. Steps
    that are not set are skipped.
    """

    def __init__(self, inputs: Mapping[str, Sequence[int]]) -> None:
        self.inputs = inputs
        self.transpose: dict[str, Sequence[int]] = {}
        self.channel_swap: dict[str, Sequence[int]] = {}
        self.raw_scale: dict[str, float] = {}
        self.mean: dict[str, Array] = {}
        self.input_scale: dict[str, float] = {}

    def preprocess(self, in_: str, data: Array) -> NDArray[np.float32]:
        """Convert an image (H, W, K) for the input blob ``in_``: to (K, H', W') if a
        transpose is set.

        Order: float32; resize to the input; transpose; channel swap; raw scale; mean; input scale.
        The image itself is not changed. Raises NetlibError.
        """
        shape = self._shape(in_)
        if len(shape) != 4:
            raise ShapeError(
                f"preprocess needs an input (N, K, H, W), but {in_!r} has shape {tuple(shape)}"
            )
        size = tuple(shape[2:])
        image = np.asarray(data).astype(np.float32)
        if image.shape[:2] != size:
            image = resize_image(image, size)
        try:
            if in_ in self.transpose:
                image = image.transpose(self.transpose[in_])
            if in_ in self.channel_swap:
                image = image[list(self.channel_swap[in_])]
        except (ValueError, IndexError):
            raise ShapeError(
                f"preprocess takes an image (H, W, {shape[1]}) for {in_!r}, found {np.shape(data)}"
            ) from None
        if in_ in self.raw_scale:
            image *= self.raw_scale[in_]
        if in_ in self.mean:
            _subtract(image, self.mean[in_], in_)
        if in_ in self.input_scale:
            image *= self.input_scale[in_]
        return image

    def deprocess(self, in_: str, data: Array) -> Array:
        """Invert ``preprocess``, except for resizing; axes of length 1 are removed."""
        self._shape(in_)
        image = data.copy()
        if image.ndim == 4 and len(image) == 1:
            image = image[0]
        if in_ in self.input_scale:
            image /= self.input_scale[in_]
        if in_ in self.mean:
            _subtract(image, -self.mean[in_], in_)
        if in_ in self.raw_scale:
            image /= self.raw_scale[in_]
        if in_ in self.channel_swap:
            image = image[np.argsort(self.channel_swap[in_])]
        if in_ in self.transpose:
            if image.ndim != len(self.transpose[in_]):
                raise ShapeError(
                    f"deprocess takes one item of {in_!r}, found an array of shape {data.shape}"
                )
            image = image.transpose(np.argsort(self.transpose[in_]))
        return image.squeeze()

    def set_transpose(self, in_: str, order: Sequence[int]) -> None:
        """Set the order of the axes: (2, 0, 1) converts (H, W, K) to (K, H, W)."""
        axes = len(self._shape(in_)) - 1
        if sorted(order) != list(range(axes)):
            raise ShapeError(
                f"Transpose order needs to have the same number of dimensions as the input: {in_!r} takes "
                f"each of {', '.join(map(str, range(axes)))} once, found {plain(order)}"
            )
        self.transpose[in_] = order

    def set_channel_swap(self, in_: str, order: Sequence[int]) -> None:
        """Set the order of the channels, the first axis after the transpose: (2, 1, 0)
        converts RGB to BGR.
        """
        channels = self._shape(in_)[1]
        if len(order) != channels or not set(order) <= set(range(channels)):
            raise ShapeError(
                f"Channel swap needs to have the same number of dimensions as the input channels: {in_!r} "
                f"has {', '.join(map(str, range(channels)))}, found {plain(order)}"
            )
        self.channel_swap[in_] = order

    def set_raw_scale(self, in_: str, scale: float) -> None:
        """Set the factor applied before the mean is subtracted: 255 converts [0, 1] to [0, 255]."""
        self._shape(in_)
        self.raw_scale[in_] = scale

    def set_mean(self, in_: str, mean: Array) -> None:
        """Set the mean to subtract: one number per channel (K,), or an image (H, W) or (K, H, W),
        resized to fit.
        """
        _, channels, *size = self._shape(in_)
        mean = np.asarray(mean)
        if mean.ndim not in (1, 2, 3):
            raise ShapeError(
                f"Mean shape invalid: expected (K,), (H, W) or (K, H, W), found {mean.shape}"
            )
        given = 1 if mean.ndim == 2 else len(mean)
        if given != channels and (given != 1 or mean.ndim == 1):
            raise ShapeError(
                f"Mean channels incompatible with input: {in_!r} has {channels}, found a mean of shape "
                f"{mean.shape}"
            )
        mean = mean if mean.dtype.kind == "f" else mean.astype(np.float64)
        if mean.ndim == 1:
            mean = mean[:, None, None]
        elif mean.shape[-2:] != tuple(size):
            image = mean[None] if mean.ndim == 2 else mean
            mean = resize_image(image.transpose(1, 2, 0), size).transpose(2, 0, 1)
        self.mean[in_] = mean

    def set_input_scale(self, in_: str, scale: float) -> None:
        """Set the factor applied last."""
        self._shape(in_)
        self.input_scale[in_] = scale

    def _shape(self, in_: str) -> Sequence[int]:
        """Shape of an input. Raises NetlibError if it does not exist."""
        if in_ not in self.inputs:
            known = ", ".join(map(repr, self.inputs)) or "none"
            raise NetlibError(
                f"{in_!r} is not one of the net inputs: {known}{did_you_mean(str(in_), self.inputs)}"
            )
        return self.inputs[in_]


def _subtract(image: Array, mean: Array, in_: str) -> None:
    try:
        image -= mean
    except ValueError:
        raise ShapeError(
            f"the mean of {in_!r} has shape {mean.shape}, the array {image.shape}; set a transpose if it is missing"
        ) from None


# ------------------------------------------------------------------------------------------- images


def load_image(filename: str | Path | BinaryIO, color: bool = True) -> NDArray[np.float32]:
    """Read an image file as (H, W, 3), red first, or gray as (H, W, 1). Alpha is dropped.

    8 and 16 bits are scaled to [0, 1]; floats are not scaled. Instead of a name, a file that is
    open for reading bytes or a BytesIO can be given. Raises DataError.
    """
    if isinstance(filename, (str, Path)):
        raw = files.read_bytes(filename, "the image")
    elif not isinstance(raw := filename.read(), bytes):
        raise DataError(
            "load_image got a file opened as text; expected one opened for bytes, or io.BytesIO"
        )
    else:
        filename = getattr(filename, "name", "the image")
    pixels = pictures.decode(raw, cv2.IMREAD_UNCHANGED, str(filename))
    if pixels.dtype.kind not in "uf":
        raise DataError(
            f"{filename}: image of type {pixels.dtype}; expected 8 or 16 bits unsigned, or floats"
        )
    if pixels.ndim == 3 and pixels.shape[2] not in (3, 4):
        raise DataError(
            f"{filename}: image with {pixels.shape[2]} channels; expected gray or colour, alpha optional"
        )
    image = pixels.astype(np.float64)
    if pixels.dtype.kind == "u":
        image /= 2 ** (8 * pixels.itemsize) - 1
    image = image[:, :, None] if image.ndim == 2 else image[:, :, 2::-1]  # OpenCV stores BGR
    if color:
        image = np.broadcast_to(image, (*image.shape[:2], 3))
    elif image.shape[2] == 3:
        image = (image @ np.array(GRAY))[:, :, None]
    return image.astype(np.float32)


def resize_image(im: Array, new_dims: Size, interp_order: int = 1) -> NDArray[np.float32]:
    """Resize an image (H, W, K) by spline interpolation of the given order (1: bilinear).

    With 1 or 3 channels, pixels are areas, and the outside has the minimum value of the image, so
    borders darken slightly. With other numbers of channels, the centres of the corner pixels stay
    fixed. Neither mode averages when downsampling. Raises ShapeError.
    """
    im = np.asarray(im)
    height, width = (int(n) for n in new_dims) if len(new_dims) == 2 else (0, 0)
    if im.ndim != 3 or not im.size or height < 1 or width < 1 or interp_order not in range(6):
        raise ShapeError(
            "resize_image takes an image (H, W, K), a (height, width) and an order from 0 to 5, found an "
            f"array of shape {im.shape}, {plain(new_dims)} and {interp_order}"
        )
    factors = (height / im.shape[0], width / im.shape[1], 1)
    if im.shape[2] not in (1, 3):
        return scipy.ndimage.zoom(im, factors, order=interp_order).astype(np.float32)
    if im.dtype.kind != "f":
        im = im.astype(np.float64)  # a difference of small signed integers overflows
    least = im.min()
    most = im.max()
    if not most > least:
        return np.full((height, width, im.shape[2]), least, np.float32)
    scaled = (im - least) / (most - least)
    scaled = scipy.ndimage.zoom(
        scaled, factors, order=interp_order, mode="grid-constant", cval=0, grid_mode=True
    )
    np.clip(scaled, 0, 1, out=scaled)  # orders above 1 overshoot
    return (scaled * (most - least) + least).astype(np.float32)


def oversample(images: Sequence[Array] | Array, crop_dims: Size) -> NDArray[np.float32]:
    """Ten crops of every image (H, W, K): four corners, the centre, and their mirror images;
    (10 N, h, w, K).

    All images must have the same size. Raises ShapeError.
    """
    shapes = list(dict.fromkeys(np.shape(image) for image in images))
    if len(shapes) != 1:
        found = " and ".join(map(str, shapes)) or "none"
        raise ShapeError(
            f"oversample takes at least one image, all of the same shape, found {found}"
        )
    [shape] = shapes
    height, width = (int(n) for n in crop_dims)
    if len(shape) != 3 or not (0 < height <= shape[0] and 0 < width <= shape[1]):
        raise ShapeError(
            f"oversample cannot crop ({height}, {width}) from an image of shape {shape}"
        )
    bottom, right = shape[0] - height, shape[1] - width
    corners = [(0, 0), (0, right), (bottom, 0), (bottom, right), (bottom // 2, right // 2)]
    stack = np.asarray(images, np.float32)
    crops = np.stack([stack[:, y : y + height, x : x + width] for y, x in corners], axis=1)
    both = np.stack([crops, crops[..., ::-1, :]], axis=1)
    return both.reshape(-1, height, width, shape[2])
