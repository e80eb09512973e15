"""caffe.Detector: a net that classifies windows of images."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from netlib.blob import Array
from netlib.caffe.classifier import transformer_of
from netlib.caffe.io import ShapeError, load_image, plain, resize_image
from netlib.caffe.pycaffe import Net
from netlib.errors import NetlibError
from netlib.layer import TEST


class Detector(Net):
    """A net in phase TEST that is run on windows of images, each warped to the size of its first input.

    mean, input_scale, raw_scale, channel_swap   as for Transformer
    context_pad                                  width in pixels of a border of the input that shows the surroundings of
                                                 the window, filled with the mean beyond the image; None or 0: no border
    """

    def __init__(
        self,
        model_file: str | Path,
        pretrained_file: str | Path,
        mean: Array | None = None,
        input_scale: float | None = None,
        raw_scale: float | None = None,
        channel_swap: Sequence[int] | None = None,
        context_pad: int | None = None,
    ) -> None:
        super().__init__(model_file, TEST, weights=pretrained_file)
        self.transformer = transformer_of(self, mean, input_scale, raw_scale, channel_swap)
        self.configure_crop(context_pad)

    def detect_windows(self, images_windows: Iterable[tuple[str, Iterable[Sequence[int]]]]) -> list[dict[str, Any]]:
        """Classify windows; returns dicts of "window", "prediction" (first output of the net) and "filename".

        ``images_windows`` are pairs of an image file and its windows, each (ymin, xmin, ymax, xmax) in pixels. Raises
        DataError, ShapeError.
        """
        found: list[dict[str, Any]] = []
        items: list[Array] = []
        name = self.inputs[0]
        for filename, windows in images_windows:
            image = load_image(filename)
            for window in windows:
                items.append(self.transformer.preprocess(name, self.crop(image, window)))
                found.append({"window": window, "filename": filename})
        if not found:
            return []
        predictions = self.forward_all(**{name: np.stack(items)})[self.outputs[0]]
        for one, prediction in zip(found, predictions):
            one["prediction"] = prediction
        return found

    def detect_selective_search(self, image_fnames: Iterable[str]) -> NoReturn:
        """Not supported, because pycaffe uses MATLAB for it. Raises NetlibError."""
        raise NetlibError(
            "detect_selective_search needs MATLAB and selective_search_ijcv_with_python, which are not supported; "
            "pass your own windows to detect_windows"
        )

    def crop(self, im: Array, window: Sequence[int]) -> Array:
        """Crop a window (ymin, xmin, ymax, xmax) of an image (H, W, K), and surroundings if ``context_pad`` is set.

        The result has the window's size, or with ``context_pad`` the size of the net's input. Raises ShapeError if the
        window is outside the image.
        """
        try:
            box = np.array([int(x) for x in window])
        except (TypeError, ValueError, OverflowError):
            box = np.zeros(0)
        if box.shape != (4,):
            raise ShapeError(f"a window is (ymin, xmin, ymax, xmax) in pixels, found {window!r}")
        size = int(self.crop_dims[1])
        if self.context_pad:
            box = _around(box, size / (size - 2 * self.context_pad))
        inside = np.clip(box, 0, [*im.shape[:2], *im.shape[:2]])
        part = im[inside[0] : inside[2], inside[1] : inside[3]]
        if not part.size:
            raise ShapeError(
                f"the window {plain(window)} (ymin, xmin, ymax, xmax) is outside an image of "
                f"{im.shape[0]} x {im.shape[1]} pixels"
            )
        if not self.context_pad:
            return part
        scale = size / (box[2:] - box[:2] + 1)  # from image to input
        y, x = np.round(np.maximum(0, -box[:2]) * scale).astype(int)  # start of the image in the input
        h, w = np.round((inside[2:] - inside[:2] + 1) * scale).astype(int)
        h, w = min(h, size - y), min(w, size - x)  # rounding can exceed the input by one
        crop = np.ones(self.crop_dims, np.float32) * self.crop_mean
        if h > 0 and w > 0:
            crop[y : y + h, x : x + w] = resize_image(part, (h, w))
        return crop

    def configure_crop(self, context_pad: int | None) -> None:
        """Set ``context_pad`` and the values that depend on it: the crop size, and the mean in the layout of an image.

        Raises ShapeError if the border does not fit the net's input.
        """
        name = self.inputs[0]
        shape = self.blobs[name].data.shape[1:]
        back = np.argsort(self.transformer.transpose[name])
        self.crop_dims = np.array(shape)[back]
        self.context_pad = context_pad
        if not context_pad:
            return
        if shape[1] != shape[2] or not 0 < 2 * context_pad < shape[1]:
            raise ShapeError(
                f"context_pad {context_pad} needs a square input of more than twice as many pixels, "
                f"{name!r} has {shape[1]} x {shape[2]}"
            )
        mean = self.transformer.mean.get(name)
        if mean is None:
            self.crop_mean: Array = np.zeros(self.crop_dims, np.float32)
            return
        crop_mean = np.reshape(mean, (1,) * (3 - mean.ndim) + mean.shape).transpose(back)
        if name in self.transformer.channel_swap and crop_mean.shape[2] > 1:
            crop_mean = crop_mean[:, :, np.argsort(self.transformer.channel_swap[name])]
        self.crop_mean = crop_mean / self.transformer.raw_scale.get(name, 1)


def _around(window: Array, scale: float) -> Array:
    """Scale a window about its centre, in whole pixels; as in Caffe, its last row and column are included."""
    half = (window[2:] - window[:2] + 1) / 2
    middle = window[:2] + half
    return np.round([*(middle - scale * half), *(middle + scale * half)]).astype(int)
