"""Pictures as files: matplotlib figures if it is installed, and images, written whole or not at all."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from netlib import files
from netlib.errors import NetlibError, reason_of
from netlib.files import atomic
from tools.common import outputs

JPEG_QUALITY = 90


def new_figure(width: float, height: float) -> Any:
    """A matplotlib figure, width x height in inches, that needs no window. Raises NetlibError without matplotlib."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it warns of a home that cannot be written
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise NetlibError("matplotlib is missing: pip install matplotlib") from error
    return Figure(figsize=(width, height), layout="constrained")


def write_figure(path: str | Path, figure: Any, dpi: int) -> None:
    """Write a figure in the format that the name ends in, tightly cut. Raises NetlibError."""
    how = {"format": Path(path).name.rpartition(".")[2].lower(), "bbox_inches": "tight", "pad_inches": 0.15}
    _write(path, lambda file: figure.savefig(file, dpi=dpi, **how))


def write_image(path: str | Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write an image, blue first, as PNG or JPEG by the end of its name. Raises NetlibError.

    OpenCV itself does not see the name: it ends the process for one that is not UTF-8.
    """
    suffix = Path(path).suffix.lower()
    options = (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY) if suffix == ".jpg" else ()
    encoded = cv2.imencode(suffix, image, options)[1].tobytes()
    _write(path, lambda file: file.write_bytes(encoded))


def make_folder(out: Path) -> None:
    """Make the folder that pictures go into, where it is missing. Raises NetlibError."""
    try:
        files.make_folder(out)
    except OSError as error:
        raise NetlibError(f"{out}: cannot write pictures there: {reason_of(error)}") from error


def places(images: Sequence[str], out: Path, ending: str) -> list[Path]:
    """Where the picture of each image goes: into the folder ``out``, under the image's name with another ending.

    Where an image comes again, its further pictures are numbered from 2 on. Raises NetlibError if two would go to one
    place, or one over an input.
    """
    found: list[Path] = []
    for n, image in enumerate(images):
        before = images[:n].count(image)
        place = out / f"{Path(image).stem}{f'_{before + 1}' if before else ''}{ending}"
        if place in found:
            raise NetlibError(f"{image}: its picture {place} would overwrite another's; run once per folder")
        outputs.refuse_inputs(place, images)
        found.append(place)
    return found


def _write(path: str | Path, fill: Callable[[Path], object]) -> None:
    try:
        atomic.replace(Path(path), fill)
    except (OSError, ValueError) as error:  # ValueError: matplotlib does not know the format
        raise NetlibError(f"{path}: cannot write the picture: {reason_of(error)}") from error
