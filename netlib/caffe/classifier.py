"""caffe.Classifier: a net that classifies images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from netlib.blob import Array
from netlib.caffe import io, removed
from netlib.caffe.pycaffe import Net
from netlib.errors import NetlibError
from netlib.layer import TEST


class Classifier(Net):
    """A net in phase TEST with preprocessing for its first input. Raises NetlibError.

    image_dims                                   height and width to which images are scaled
                                                 before they are cropped to the input's size; by
                                                 default that size
    mean, input_scale, raw_scale, channel_swap   as for Transformer
    """

    def __init__(
        self,
        model_file: str | Path,
        pretrained_file: str | Path,
        image_dims: Sequence[int] | None = None,
        mean: Array | None = None,
        input_scale: float | None = None,
        raw_scale: float | None = None,
        channel_swap: Sequence[int] | None = None,
        **others: object,
    ) -> None:
        for option in others:
            advice = removed.CLASSIFIER.get(option, "it has no such option")
            raise TypeError(f"Classifier(..., {option}=...): {advice}")
        super().__init__(model_file, TEST, weights=pretrained_file)
        if not self.inputs:
            raise NetlibError(
                f"net {self.name!r} has no input for images; expected a deployment net with an Input "
                "layer"
            )
        name = self.inputs[0]
        shape = self.blobs[name].data.shape
        self.transformer = io.Transformer({name: shape})
        self.transformer.set_transpose(name, (2, 0, 1))
        if mean is not None:
            self.transformer.set_mean(name, mean)
        if input_scale is not None:
            self.transformer.set_input_scale(name, input_scale)
        if raw_scale is not None:
            self.transformer.set_raw_scale(name, raw_scale)
        if channel_swap is not None:
            self.transformer.set_channel_swap(name, channel_swap)
        self.crop_dims = np.array(shape[2:])
        self.image_dims: io.Size = self.crop_dims
        if image_dims is not None and len(image_dims):
            self.image_dims = image_dims
        if len(self.image_dims) != 2 or (np.array(self.image_dims) < self.crop_dims).any():
            raise io.ShapeError(
                f"image_dims {io.plain(self.image_dims)} are smaller than the net's input, "
                f"{io.plain(self.crop_dims)}; expected a height and a width"
            )

    def predict(self, inputs: Sequence[Array], oversample: bool = True) -> NDArray[np.float32]:
        """Predict the net's first output for each image (H, W, K); returns (N, ...).

        With ``oversample``, returns the mean over crops of corners, centre and their mirror images,
        (N, C); otherwise the centre crop is used. Raises ShapeError.
        """
        if not len(inputs) or len({np.shape(image)[2:] for image in inputs}) > 1:
            raise io.ShapeError(
                "predict takes images (H, W, K) with the same K, found "
                f"{[np.shape(image) for image in inputs]}"
            )
        images = np.stack([io.resize_image(image, self.image_dims) for image in inputs])
        crops = io.oversample(images, self.crop_dims) if oversample else self._centres(images)
        name = self.inputs[0]
        items = np.stack([self.transformer.preprocess(name, crop) for crop in crops])
        predictions: NDArray[np.float32] = self.forward_all(**{name: items})[self.outputs[0]]
        if not oversample:
            return predictions
        return predictions.reshape(len(images), 10, -1).mean(axis=1)

    def _centres(self, images: Array) -> Array:
        """The centre of each image (N, H, W, K), of the size of the net's input."""
        h, w = self.crop_dims
        y, x = (images.shape[1] - h) // 2, (images.shape[2] - w) // 2
        return images[:, y : y + h, x : x + w]


class Detector:
    """Not supported. Raises NotImplementedError."""

    def __init__(self, *args: object, **options: object) -> None:
        raise NotImplementedError(
            "Detector, for the windows of R-CNN (2014), is not supported; crop the windows from the images and give "
            "them to Classifier.predict(windows, oversample=False)"
        )
