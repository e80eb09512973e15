"""WindowData: batches of windows cropped from images, for training a detector (R-CNN).

top[0]  data   (batch_size, 3, S, S)  windows, warped to S = ``crop_size`` of transform_param; BGR order
top[1]  label  (batch_size,)          class of the object, 0 for background

``source`` lists the windows, as words and numbers separated by whitespace:

    # 0                         number of the image, from 0
    path                        ``root_folder`` is prepended without a slash
    channels height width       channels must be 3
    count                       number of windows, and for each of them:
    class overlap x1 y1 x2 y2   overlap with the true box of an object; corners in pixels, inclusive

A window whose overlap is at least ``fg_threshold`` is foreground; one whose overlap is below ``bg_threshold`` is
background, whatever its class; others are not used. A batch is a random choice with a fraction ``fg_fraction`` of
foreground: first the background, then the foreground.

With ``context_pad`` p, each window includes a border of its surroundings that is p wide after warping;
``crop_mode: "square"`` first extends the window to a square. Parts outside the image are 0. Elsewhere

    y = scale (x - mean)

where ``scale`` is that of this block (not of transform_param, as in Caffe), and a mean image is cropped to its centre.
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
from layers.data.transform import TransformationParameter, Transformer, warn_of_misplaced
from netlib import files
from netlib.blob import Array, Blobs
from netlib.errors import DataError, did_you_mean
from netlib.files.paths import find
from netlib.layer import warn_of_ignored
from netlib.proto.schema import UInt, numbered, round_to_32_bits

T = TypeVar("T", int, float)


@dataclass(frozen=True)
class WindowDataParameter:
    """The ``window_data_param { ... }`` block."""

    source: str = numbered(1)  # path of the list of windows
    batch_size: UInt = numbered(4)
    scale: float = numbered(2, 1.0)
    fg_threshold: float = numbered(7, 0.5)  # minimum overlap of foreground windows
    bg_threshold: float = numbered(8, 0.5)  # maximum overlap of background windows, exclusive
    fg_fraction: float = numbered(9, 0.25)  # fraction of foreground in a batch
    context_pad: UInt = numbered(10, 0)  # border around a window, in pixels of the result
    crop_mode: str = numbered(11, "warp")  # or "square": the smallest square around a window
    cache_images: bool = numbered(12, False)  # keep the files in memory; accepted, ignored
    root_folder: str = numbered(13, "")  # prepended to every path in the list
    mean_file: str | None = numbered(3, None)  # this and the following are ignored; see transform_param
    crop_size: UInt = numbered(5, 0)
    mirror: bool = numbered(6, False)


class Window(NamedTuple):
    """A window of an image, corners inclusive."""

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
            raise self.fail(f"context_pad {p.context_pad} on both sides exceeds crop_size {self.size}",
                            "context_pad")
        self.mean = self._mean()
        self.list = find(p.source, self.source)
        windows = _read_windows(self.list)
        self.foreground = [window for window, overlap in windows if overlap >= p.fg_threshold]
        self.background = [window._replace(label=0) for window, overlap in windows
                           if overlap < p.fg_threshold and overlap < p.bg_threshold]
        for window in self.foreground:
            if window.label < 1:
                raise DataError(f"{self.list}: a foreground window of {window.path} has class {window.label}; "
                                "expected 1 or more, as 0 is the background")
        if not self.foreground or not self.background:
            raise DataError(f"{self.list}: {len(self.foreground)} foreground and {len(self.background)} background "
                            "windows; expected some of both")
        self.notes = [f"{len(self.foreground)} foreground and {len(self.background)} background windows in {p.source}"]
        warn_of_misplaced(self, "mean_file", "crop_size", "mirror")
        warn_of_ignored(self, "scale", block="transform_param", advice="; write it in window_data_param")
        warn_of_ignored(self, "force_color", "force_gray", block="transform_param")

    def _mean(self) -> Array:
        """Mean (3, S, S): the centre of the mean image, or the given numbers."""
        S, mean, p = self.size, self.transformer.mean, self.transformer.param
        if p.mean_file is not None:
            first = (mean.shape[2] - S) // 2  # row and column offsets both come from the width, as in Caffe
            if mean.shape[0] != 3 or first < 0 or first + S > min(mean.shape[1:]):
                raise self.transformer.fail(f"mean_file {p.mean_file!r} has shape {mean.shape}, too small for a crop "
                                            f"of {(3, S, S)}", "mean_file")
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
        """Identity of the windows."""
        return [
            len(self.foreground),
            len(self.background),
            zlib.crc32(repr(self.foreground + self.background).encode()),
        ]

    def _cut(self, window: Window, mirrored: bool, y: Array) -> None:
        """Write one warped window to ``y`` (3, S, S)."""
        p, S = self.param, self.size
        if window.x2 < window.x1 or window.y2 < window.y1:
            raise DataError(f"{self.list}: window {window[2:]} of {window.path} ends before it starts; "
                            "expected x1 y1 x2 y2")
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
            height, width = min(height, S - at_row), min(width, S - at_column)  # rounding can exceed it by a pixel
        if not (0 <= rows[0] <= rows[1] < image.shape[0] and 0 <= columns[0] <= columns[1] < image.shape[1]):
            raise DataError(f"{self.list}: window {window[2:]} is outside {window.path}, which has "
                            f"{image.shape[1]} columns and {image.shape[0]} rows")
        if height < 1 or width < 1:
            raise DataError(f"{self.list}: window {window[2:]} of {window.path} has less than a pixel inside the image")
        part = resize_image(image[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1], height, width)
        x = planes(part[:, ::-1] if mirrored else part).astype(y.dtype)
        place = np.s_[:, at_row : at_row + height, at_column : at_column + width]
        y[place] = (x - self.mean[place]) * y.dtype.type(p.scale)

    def _widened(self, first: int, size: int, wanted: int, length: int) -> tuple[tuple[int, int], tuple[int, int], int]:
        """Extend a window along one axis to the wanted size around its centre, with its border, in an image.

        Returns its first and last pixel inside the image, the parts of S before and after it that are outside, and the
        rest of S.
        """
        real: Any = self.dtype.type  # Caffe rounds in the net's dtype
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
    """Round to the nearest integer, halves away from 0, as in C."""
    return int(math.copysign(math.floor(abs(float(number)) + 0.5), number))


def _read_windows(path: Path) -> list[tuple[Window, float]]:
    """Read the windows of a list, with their overlaps. Raises DataError."""
    words = iter(files.read_text(path, "the list of windows").split())
    found: list[tuple[Window, float]] = []
    channels, images = 0, 0
    for word in words:
        if word != "#":
            raise DataError(f"{path}: found {word!r}, expected '#' and image {images}")
        what = f"{path}: image {images}"
        number = _next(words, int, f"{what}: its number")
        if number != images:
            raise DataError(f"{what}: has number {number}; expected images numbered from 0")
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
    """Convert the next word to a number. Raises DataError."""
    word = next(words, None)
    try:
        return kind(word)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        end = "the list ends" if word is None else f"found {word!r}"
        raise DataError(f"{what}: {end}, expected {'an integer' if kind is int else 'a number'}") from None
