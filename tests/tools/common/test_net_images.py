"""tools/common/net_images.py: the input of a net from images, and boxes in px of the image."""

from __future__ import annotations

import numpy as np
import pytest

from netlib.errors import NetlibError
from tools.common.net_images import Preprocessing, mean_of


def preprocessing(**changes: object) -> Preprocessing:
    """Return the steps for an input of 4 x 2 px from images of 8 x 4, with these changes."""
    steps = {"size": (4, 2), "resize": (8, 4), "crop": False, "rgb": False, "mean": np.zeros((3, 1, 1)), "scale": 1.0}
    return Preprocessing(**{**steps, **changes})  # type: ignore[arg-type]


def test_the_input_is_cut_from_the_centre() -> None:
    """The mean image has the size of the resized image, and is cut with it."""
    image = np.arange(4 * 8 * 3, dtype=np.uint8).reshape(4, 8, 3)
    mean = np.full((3, 4, 8), 5, np.float32)
    mean[:, 1, 2] = 1
    blob = preprocessing(mean=mean, scale=2).blob([image])
    assert blob.shape == (1, 3, 2, 4)
    assert blob[0, :, 0, 0].tolist() == [2 * (value - 1) for value in image[1, 2].tolist()]
    assert blob[0, :, 1, 3].tolist() == [2 * (value - 5) for value in image[2, 5].tolist()]


@pytest.mark.parametrize(
    ("changes", "shape", "expected"),
    [
        ({"resize": (4, 2)}, (20, 8, 3), [2, 0, 4, 20]),  # stretched
        ({}, (4, 8, 3), [3, 1, 4, 3]),  # not resized: the input begins at (2, 1)
        ({"resize": (4, 2), "crop": True}, (8, 8, 3), [2, 2, 4, 6]),  # 4 x 4 px, of which 1 is cut at the top
    ],
)
def test_boxes_in_the_image(changes: dict[str, object], shape: tuple[int, ...], expected: list[float]) -> None:
    """A box in units of the input is converted for each way to resize."""
    box = preprocessing(**changes).to_image(np.array([0.25, 0, 0.5, 1]), shape)
    assert box.tolist() == expected


def test_sizes_must_agree() -> None:
    with pytest.raises(NetlibError, match="images of 3 x 4 px are smaller than the net's input, 4 x 2"):
        preprocessing(resize=(3, 4))
    with pytest.raises(NetlibError, match="the mean image has 5 x 4 px, images are resized to 8 x 4"):
        preprocessing(mean=np.zeros((3, 4, 5)))


def test_a_mean_from_numbers() -> None:
    assert mean_of((7,), None, 3).tolist() == [[[7]]] * 3
    assert mean_of((), None, 3).tolist() == [[[0]]] * 3
    assert mean_of((1, 2, 3), None, 3).ravel().tolist() == [1, 2, 3]
