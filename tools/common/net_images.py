"""Images for any net: its input, the mean, and preprocessing as in cv2.dnn.blobFromImage or
Caffe's data layers.
"""

from __future__ import annotations

import argparse
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from layers.data.images import read_image
from netlib import files
from netlib.blob import Array
from netlib.caffe.proto.ssd import LabelMap
from netlib.errors import DataError, NetlibError, reason_of, warn_once
from netlib.files.paths import list_folder
from netlib.net import Net
from netlib.proto import prototxt, schema
from netlib.proto.binaryproto import read_blob
from tools.common.arguments import numbers, positive_number

Size = tuple[int, int]  # width and height in px
# the paths, the images and the named blobs of the images that a net computes together
Pass = tuple[Sequence[str], list[Array], Mapping[str, Array]]
MAX_LABELS = 1 << 16
PICTURES = (".bmp", ".jpeg", ".jpg", ".png", ".pgm", ".ppm", ".tif", ".tiff", ".webp")


@dataclass(frozen=True)
class Preprocessing:
    """How images (H, W, C), blue first, become an input (N, C, H, W).

    size     of the input; the net is reshaped to it
    resize   images are resized to this size, and ``size`` is cut from the centre, as Caffe's data
             layers do in phase TEST
    crop     images keep their aspect ratio when resized: the centre is cut out. Otherwise
             they are stretched
    rgb      the first channel of the input is red
    mean     (C, 1, 1) or, for images of size ``resize``, (C, H, W), in the order of the
             input's channels
    scale    factor, applied after the mean is subtracted
    """

    size: Size
    resize: Size
    crop: bool
    rgb: bool
    mean: Array
    scale: float

    def __post_init__(self) -> None:
        (width, height), (w, h) = self.resize, self.size
        if width < w or height < h:
            raise NetlibError(
                f"images of {width} x {height} px are smaller than the net's input, {w} x {h}"
            )
        if self.mean.shape[1:] not in ((1, 1), (height, width)):
            raise NetlibError(
                f"the mean image has {self.mean.shape[2]} x {self.mean.shape[1]} px, images are resized "
                f"to {width} x {height}; expected the same size, or one number per channel"
            )

    def blob(self, images: Sequence[Array]) -> NDArray[np.float32]:
        """Return the input of the net for images."""
        blob: Any = cv2.dnn.blobFromImages(images, 1.0, self.resize, (0, 0, 0), self.rgb, self.crop)
        blob -= self.mean
        (width, height), (w, h) = self.resize, self.size
        y, x = (height - h) // 2, (width - w) // 2
        return blob[:, :, y : y + h, x : x + w] * np.float32(self.scale)

    def to_image(self, box: Array, shape: Sequence[int]) -> Array:
        """Convert xmin, ymin, xmax, ymax in units of the input's width and height to px of an
        image of (H, W, C).
        """
        image = np.array(shape[1::-1])
        resized = np.array(self.resize)
        size = np.array(self.size)
        scale = resized / image
        if self.crop:
            scale = np.full(2, scale.max())
        cut = (image * scale - resized) / 2 + (resized - size) // 2
        return ((box.reshape(2, 2) * size + cut) / scale).ravel()


def add_value_options(group: argparse._ArgumentGroup, scale: float | None) -> None:
    """Add the options about an image's values; ``scale`` is the default of that option."""
    mean = group.add_mutually_exclusive_group()
    mean.add_argument(
        "--mean",
        type=numbers(),
        metavar="M[,M,M]",
        default=(),
        help="to subtract: one number, or one per channel of the input"
        f"{'' if scale is None else ' (default: nothing)'}",
    )
    mean.add_argument(
        "--mean-file", metavar="FILE", help="mean image to subtract, .binaryproto or .npy"
    )
    group.add_argument(
        "--scale",
        type=positive_number,
        metavar="S",
        default=scale,
        help=f"factor, after the mean{'' if scale is None else f' (default: {scale:g})'}",
    )
    group.add_argument(
        "--rgb", action="store_true", help="the net's first channel is red (Caffe's is blue)"
    )


def preprocessing_of(
    net: Net,
    args: argparse.Namespace,
    size: Size | None = None,
    resize: Size | None = None,
    crop: bool = False,
) -> Preprocessing:
    """How images become the input of a net, by the parsed options of ``add_value_options``.

    By default, the input has the size of the prototxt, and images are resized to that of
    the mean image, or without one to the input's. Raises NetlibError.
    """
    _, (_, channels, height, width) = image_input(net)
    mean = mean_of(args.mean, args.mean_file, channels)
    size = size or (width, height)
    has_mean_image = mean.shape[1:] != (1, 1)
    size_of_mean = (mean.shape[2], mean.shape[1])
    resize = resize or (size_of_mean if has_mean_image else size)
    return Preprocessing(size, resize, crop, args.rgb, mean, args.scale)


def passes(
    net: Net,
    paths: Sequence[str],
    preprocessing: Preprocessing,
    blobs: Sequence[str],
    batch: int | None = None,
) -> Iterator[Pass]:
    """Run the net on images, ``batch`` at a time, by default as many as the prototxt has: yields
    their paths, the images and the named blobs.

    Raises NetlibError.
    """
    name, (of_net, channels, *_) = image_input(net)
    batch = batch or of_net
    for begin in range(0, len(paths), batch):
        some = paths[begin : begin + batch]
        images = [read_image(Path(path), channels != 1) for path in some]
        inputs: dict[str, Any] = {name: preprocessing.blob(images)}
        arrays = net.forward(blobs, **inputs)
        if not all(np.isfinite(array).all() for array in arrays.values()):
            warn_once(
                f"NaN or infinity, first in {net.first_not_finite()}: check the weights, the mean and the scale"
            )
        yield some, images, arrays


def pictures_in(folder: Path) -> list[str]:
    """The paths of the pictures in a folder, with numbers in their names in the order
    of their values.

    Raises DataError.
    """
    names = [
        name
        for name in list_folder(folder)
        if Path(name).suffix.lower() in PICTURES and name[0] != "."
    ]
    return [str(folder / name) for name in sorted(names, key=_with_numbers)]


def _with_numbers(name: str) -> list[tuple[int, str]]:
    """A key that sorts names by their numbers: 9.png before 10.png."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]


def image_input(net: Net) -> tuple[str, tuple[int, ...]]:
    """Name and shape (N, C, H, W) of the input for images. Raises NetlibError."""
    if not net.inputs:
        raise NetlibError(f"{net.source}: the net has no input; expected one, for images")
    if len(net.inputs) > 1:
        raise NetlibError(
            f"{net.source}: the net has the inputs {', '.join(net.inputs)}; expected one, for images. "
            "Python's Net.forward accepts all"
        )
    (name,) = net.inputs
    shape = net.blobs[name].shape
    if len(shape) != 4 or shape[1] not in (1, 3):
        raise NetlibError(
            f"{net.source}: the input {name!r} has shape {shape}; expected (N, C, H, W) with 3 channels, "
            "or 1 for grey images"
        )
    return name, shape


def read_labels(path: str) -> list[str]:
    """The names of the classes in a text file: one per line, or a LabelMap of SSD.

    Raises DataError.
    """
    text = files.read_text(path, "the labels")
    if re.match(r"(\s|#.*)*item\s*:?\s*[{<]", text):
        return _of_label_map(prototxt.parse(text, path))
    labels = text.rstrip("\n").split("\n")
    if labels == [""]:
        raise DataError(f"{path}: the file is empty; expected the name of a class in each line")
    return labels


def _of_label_map(tree: prototxt.Message) -> list[str]:
    """The display names of a LabelMap, or its names, by their labels. Raises DataError."""
    names: dict[int, str] = {}
    for item in schema.read(tree, LabelMap, "label map").item:
        if item.label in names or not 0 <= item.label < MAX_LABELS:
            raise DataError(
                f"{schema.position_of(item)}: the label {item.label}; expected each from 0 to "
                f"{MAX_LABELS - 1} once"
            )
        names[item.label] = item.display_name or item.name
    return [names.get(label, f"class {label}") for label in range(max(names) + 1)]


def mean_of(numbers: Sequence[float], path: str | None, channels: int) -> Array:
    """The mean from numbers, one or one per channel, or from a file; (C, 1, 1) or (C, H, W).

    Raises NetlibError.
    """
    mean = np.asarray(numbers) if path is None else _read_mean(path)
    where = "the mean" if path is None else f"{path}: the mean"
    if path is None and len(mean) < 2:
        mean = np.resize(mean, channels)
    if len(mean) != channels:
        raise NetlibError(f"{where} has {len(mean)} channels, the net's input {channels}")
    with np.errstate(over="ignore", invalid="ignore"):
        mean = mean.astype(np.float32)
    if not np.isfinite(mean).all():
        raise NetlibError(f"{where} has values that are not finite in float32")
    return mean.reshape(channels, *(mean.shape[1:] or (1, 1)))


def _read_mean(path: str) -> Array:
    """Read (C,) or (C, H, W) from a .npy or .binaryproto file. Raises DataError."""
    if path.endswith(".npy"):
        content = files.read_bytes(path, "the mean")
        try:
            mean = np.load(io.BytesIO(content), allow_pickle=False)
        except Exception as error:  # Python's parser may raise anything for a damaged header
            raise DataError(
                f"{path}: no array as NumPy writes it: {reason_of(error)[:200]}"
            ) from error
    else:
        mean = read_blob(path)
    if mean.ndim == 4 and len(mean) == 1:  # as compute_image_mean writes it
        mean = mean[0]
    if mean.ndim not in (1, 3) or mean.dtype.kind not in "fiu" or not mean.size:
        raise DataError(
            f"{path}: found {mean.dtype} {mean.shape}; expected numbers (C,), (C, H, W) or (1, C, H, W)"
        )
    return mean
