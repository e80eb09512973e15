"""Output files of commands: checks before the work starts; figures (with matplotlib) and images,
written atomically.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from netlib import files
from netlib.errors import NetlibError, printable, reason_of
from netlib.files import atomic
from netlib.files.paths import real

JPEG_QUALITY = 90
MAX_LABEL = 60  # characters


def refuse_inputs(
    out: str | Path, inputs: Iterable[str | Path | None], why: str = "is read in this run"
) -> None:
    """Raise NetlibError if ``out`` is one of the inputs, under any name.

    None in ``inputs`` is ignored.
    """
    if real(out) in {real(path) for path in inputs if path is not None}:
        raise NetlibError(f"{out}: {why}; expected another output")


def check_place(out: str | Path, inputs: Iterable[str | Path | None] = ()) -> None:
    """Raise NetlibError or OSError if a file cannot be written there or would replace an input."""
    refuse_inputs(out, inputs)
    out = Path(out)
    if not out.parent.is_dir():
        raise NetlibError(f"{out}: folder {out.parent} does not exist")
    with atomic.error_names(out), atomic.temporary(out):
        atomic.require_regular_file(out)


def label(name: str) -> str:
    """A name as matplotlib can draw it: of limited length, on one line, and not
    typeset as a formula.
    """
    return printable(name)[:MAX_LABEL].replace("$", r"\$")


def new_figure(width: float, height: float) -> Any:
    """Create a matplotlib figure of width x height inches without a window.

    Raises NetlibError without matplotlib.
    """
    # it warns if the home folder is not writable
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise NetlibError("matplotlib is missing: pip install matplotlib") from error
    return Figure(figsize=(width, height), layout="constrained")


def write_figure(path: str | Path, figure: Any, dpi: int) -> None:
    """Write a figure in the format of the file's suffix, cropped to its content.

    Raises NetlibError.
    """
    how = {
        "format": Path(path).name.rpartition(".")[2].lower(),
        "bbox_inches": "tight",
        "pad_inches": 0.15,
    }
    _write(path, lambda file: figure.savefig(file, dpi=dpi, **how))


def write_image(path: str | Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write an image in BGR order as PNG or JPEG, by the file's suffix. Raises NetlibError.

    OpenCV encodes in memory, because it aborts the process for file names that are not UTF-8.
    """
    suffix = Path(path).suffix.lower()
    options = (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY) if suffix == ".jpg" else ()

    def encode(file: Path) -> None:
        done, encoded = cv2.imencode(suffix, image, options)
        if not done:
            raise ValueError(f"{image.shape[1]} x {image.shape[0]} px are too many")
        file.write_bytes(encoded.tobytes())

    _write(path, encode)


def make_folder(out: Path) -> None:
    """Create the folder for images if it is missing. Raises NetlibError."""
    try:
        files.make_folder(out)
    except OSError as error:
        raise NetlibError(f"{out}: cannot write images there: {reason_of(error)}") from error


def places(images: Sequence[str], out: Path, ending: str) -> list[Path]:
    """Paths of the output image for each input image: in the folder ``out``, with the input's name
    and a new suffix.

    If an input is repeated, further outputs are numbered from 2. Raises NetlibError if two outputs
    would have the same path, or one would replace an input.
    """
    found: list[Path] = []
    for n, image in enumerate(images):
        before = images[:n].count(image)
        place = out / f"{Path(image).stem}{f'_{before + 1}' if before else ''}{ending}"
        if place in found:
            raise NetlibError(
                f"{image}: its output {place} would overwrite another one; run once per folder"
            )
        refuse_inputs(place, images)
        found.append(place)
    return found


def _write(path: str | Path, fill: Callable[[Path], object]) -> None:
    try:
        atomic.replace(Path(path), fill)
    # matplotlib raises ValueError for unknown formats
    except (OSError, ValueError, cv2.error) as error:
        raise NetlibError(f"{path}: cannot write the image: {reason_of(error)}") from error
