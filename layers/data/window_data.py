"""WindowData: batches of windows cut out of images, to train a detector (R-CNN).

top[0]  data   (batch_size, 3, S, S)  windows, stretched to S = ``crop_size`` of transform_param; blue, green, red
top[1]  label  (batch_size,)          the class of the object, 0 for background

``source`` lists the windows, in words and numbers with blanks or line ends between:

    # 0                         number of the image, from 0 on
    path                        follows ``root_folder`` without a slash between
    channels height width       channels must be 3
    count                       number of windows, for each of them:
    class overlap x1 y1 x2 y2   overlap with the true box of an object; corners in pixels, both included

A window whose overlap is at least ``fg_threshold`` is foreground; one whose overlap is less than ``bg_threshold`` is
background, whatever its class; others are left out. A batch is a random choice, ``fg_fraction`` of it foreground: first
the background, then the foreground.

With ``context_pad`` p, a border that is p wide after stretching is cut out around the window; ``crop_mode: "square"``
makes the window a square first. What then lies outside the image stays 0. Elsewhere

    y = scale (x - mean)

where ``scale`` is that of this block (not transform_param's, as in Caffe), and a mean image is cut to its middle.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from layers.data.images import planes, read_image, resize_image
from layers.data.reader import Reader
from layers.data.transform import TransformationParameter, Transformer, misplaced
from netlib import files
from netlib.blob import Array, Blobs
from netlib.errors import DataError, did_you_mean
from netlib.files.paths import find
from netlib.proto.schema import UInt, numbered, round_to_32_bits

T = TypeVar("T", int, float)


@dataclass(frozen=True)
class WindowDataParameter:
    """The ``window_data_param { ... }`` block."""

    source: str = numbered(1)  # the list of windows
    batch_size: UInt = numbered(4)
    scale: float = numbered(2, 1.0)
    fg_threshold: float = numbered(7, 0.5)  # least overlap of a foreground window
    bg_threshold: float = numbered(8, 0.5)  # background windows have less
    fg_fraction: float = numbered(9, 0.25)  # part of a batch that is foreground
    context_pad: UInt = numbered(10, 0)  # border around a window, in pixels of the result
    crop_mode: str = numbered(11, "warp")  # or square: the smallest square around a window
    cache_images: bool = numbered(12, False)  # keep the files in memory; accepted, ignored
    root_folder: str = numbered(13, "")  # written before every path of the list
    mean_file: str | None = numbered(3, None)  # this and those below: ignored, see transform_param
    crop_size: UInt = numbered(5, 0)
    mirror: bool = numbered(6, False)


class Window(NamedTuple):
    """A part of an image, both corners included."""

    path: str
    label: int
    x1: int
    y1: int
    x2: int
    y2: int


class WindowData(Reader):
    """Reads windows.

    foreground, background  the windows to choose from
    notes                   lines for the log
    """

    param_type = WindowDataParameter
    other_blocks: ClassVar[dict[str, type]] = {"transform_param": TransformationParameter}
    bottoms = (0, 0)
    tops = (2, 2)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.batch_size == 0:
            raise self.fail("batch_size must be at least 1", "batch_size")
        self.batch_size = self.batch_of(p.batch_size)
        if not 0 <= p.fg_fraction <= 1:
            raise self.fail(f"fg_fraction {p.fg_fraction:g} must be from 0 to 1", "fg_fraction")
        if p.crop_mode not in ("warp", "square"):
            advice = did_you_mean(p.crop_mode, ("warp", "square"))
            raise self.fail(f"crop_mode {p.crop_mode!r} must be 'warp' or 'square'{advice}", "crop_mode")
        self.transformer = Transformer(self)
        self.size = self.transformer.param.crop_size
        if self.size == 0:
            raise self.fail("needs transform_param { crop_size: ... }, the size of its windows")
        if 2 * p.context_pad >= self.size:
            raise self.fail(f"context_pad {p.context_pad} on both sides leaves nothing of crop_size {self.size}",
                            "context_pad")  # fmt: skip
        self.mean = self._mean()
        self.list = find(p.source, self.source)
        windows = _read_windows(self.list)
        self.foreground = [window for window, overlap in windows if overlap >= p.fg_threshold]
        self.background = [window._replace(label=0) for window, overlap in windows
                           if overlap < p.fg_threshold and overlap < p.bg_threshold]  # fmt: skip
        for window in self.foreground:
            if window.label < 1:
                raise DataError(f"{self.list}: a foreground window of {window.path} has class {window.label}; "
                                "expected 1 or more, for 0 is the background")  # fmt: skip
        if not self.foreground or not self.background:
            raise DataError(f"{self.list}: {len(self.foreground)} foreground and {len(self.background)} background "
                            "windows; expected some of both")  # fmt: skip
        self.notes = [f"{len(self.foreground)} foreground and {len(self.background)} background windows in {p.source}"]
        self.notes += misplaced(self, "mean_file", "crop_size", "mirror")

    def _mean(self) -> Array:
        """(3, S, S): the middle of the mean image, or numbers."""
        S, mean, p = self.size, self.transformer.mean, self.transformer.param
        if p.mean_file is not None:
            first = (mean.shape[2] - S) // 2  # of rows and columns, both from the width, as in Caffe
            if mean.shape[0] != 3 or first < 0 or first + S > min(mean.shape[1:]):
                raise self.transformer.fail(f"mean_file {p.mean_file!r} has {mean.shape}, which has no middle "
                                            f"of {(3, S, S)}", "mean_file")  # fmt: skip
            return mean[:, first : first + S, first : first + S]
        if len(mean) not in (1, 3):
            raise self.transformer.fail(f"has {len(mean)} mean_value, expected 1 or 3", "mean_value")
        return np.broadcast_to(mean, (3, S, S))

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(self.batch_size, 3, self.size, self.size)
        top[1].reshape(self.batch_size)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        N, data, labels = self.batch_size, top[0].data, top[1].data
        foreground = int(np.float32(N) * np.float32(self.param.fg_fraction))
        data[...] = 0
        for i in range(N):
            windows = self.background if i < N - foreground else self.foreground
            window = windows[self.rng.integers(len(windows))]
            mirrored = self.transformer.param.mirror and self.rng.integers(2) == 1
            self._cut(window, mirrored, data[i])
            labels[i] = window.label

    def reads(self) -> Any:
        """The windows."""
        return [
            len(self.foreground),
            len(self.background),
            zlib.crc32(repr(self.foreground + self.background).encode()),
        ]

    def _cut(self, window: Window, mirrored: bool, y: Array) -> None:
        """Write one window, stretched, into its place (3, S, S)."""
        p, S = self.param, self.size
        if window.x2 < window.x1 or window.y2 < window.y1:
            raise DataError(f"{self.list}: window {window[2:]} of {window.path} ends before it begins; "
                            "expected x1 y1 x2 y2")  # fmt: skip
        image = read_image(find(p.root_folder + window.path, self.source if p.root_folder else str(self.list)), True)
        rows, columns = (window.y1, window.y2), (window.x1, window.x2)
        at_row = at_column = 0
        height = width = S
        if p.context_pad > 0 or p.crop_mode == "square":
            sizes = rows[1] - rows[0] + 1, columns[1] - columns[0] + 1
            wanted = (max(sizes), max(sizes)) if p.crop_mode == "square" else sizes
            rows, (at_row, _), height = self._widened(rows[0], sizes[0], wanted[0], image.shape[0])
            columns, outside, width = self._widened(columns[0], sizes[1], wanted[1], image.shape[1])
            at_column = outside[1] if mirrored else outside[0]
            height, width = min(height, S - at_row), min(width, S - at_column)  # rounding may give a pixel too many
        if not (0 <= rows[0] <= rows[1] < image.shape[0] and 0 <= columns[0] <= columns[1] < image.shape[1]):
            raise DataError(f"{self.list}: window {window[2:]} does not lie in {window.path}, which has "
                            f"{image.shape[1]} columns and {image.shape[0]} rows")  # fmt: skip
        if height < 1 or width < 1:
            raise DataError(f"{self.list}: of window {window[2:]} of {window.path} less than a pixel is in the image")
        part = resize_image(image[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1], height, width)
        x = planes(part[:, ::-1] if mirrored else part).astype(y.dtype)
        place = np.s_[:, at_row : at_row + height, at_column : at_column + width]
        y[place] = (x - self.mean[place]) * y.dtype.type(p.scale)

    def _widened(self, first: int, size: int, wanted: int, length: int) -> tuple[tuple[int, int], tuple[int, int], int]:
        """Along one axis, a window grown to the wanted size around its centre, with its border, in an image.

        Returns its first and last pixel in the image, the parts of S before and after them that lie outside, and the
        part of S that is left for them.
        """
        real: Any = self.dtype.type  # Caffe rounds results of the net's own type
        S = real(self.size)
        half = real(wanted / 2) * (S / real(self.size - 2 * self.param.context_pad))
        centre = real(first) + real(size / 2)
        first, last = _round(centre - half), _round(centre + half)
        before, after = max(0, -first), max(0, last - length + 1)
        scale = S / real(last - first + 1)
        inside = last - first + 1 - before - after
        parts = [_round(real(part) * scale) for part in (before, after, inside)]
        return (first + before, last - after), (parts[0], parts[1]), parts[2]


def _round(number: Any) -> int:
    """To the nearest whole number, halves away from 0, as C rounds."""
    return int(math.copysign(math.floor(abs(float(number)) + 0.5), number))


def _read_windows(path: Path) -> list[tuple[Window, float]]:
    """The windows of a list, with their overlaps. Raises DataError."""
    words = iter(files.read_text(path, "the list of windows").split())
    found: list[tuple[Window, float]] = []
    channels, images = 0, 0
    for word in words:
        if word != "#":
            raise DataError(f"{path}: found {word!r}, expected '#' and image {images}")
        what = f"{path}: image {images}"
        number = _next(words, int, f"{what}: its number")
        if number != images:
            raise DataError(f"{what}: has the number {number}; expected images to be numbered from 0 on")
        image = next(words, "")
        channels, _, _, count = (
            _next(words, int, f"{what}: {field}") for field in ("channels", "height", "width", "the number of windows")
        )
        for i in range(count):
            label = _next(words, int, f"{what}: the class of window {i}")
            overlap = round_to_32_bits(_next(words, float, f"{what}: the overlap of window {i}"))
            x1, y1, x2, y2 = (_next(words, int, f"{what}: {corner} of window {i}") for corner in Window._fields[2:])
            found.append((Window(image, label, x1, y1, x2, y2), overlap))
        images += 1
    if images == 0:
        raise DataError(f"{path}: the list of windows is empty")
    if channels != 3:
        raise DataError(f"{path}: image {images - 1} has {channels} channels; images are read in colour, expected 3")
    return found


def _next(words: Iterator[str], kind: type[T], what: str) -> T:
    """The next word as a number. Raises DataError."""
    word = next(words, None)
    try:
        return kind(word)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        end = "the list ends" if word is None else f"found {word!r}"
        raise DataError(f"{what}: {end}, expected {'a whole number' if kind is int else 'a number'}") from None
