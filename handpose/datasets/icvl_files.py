"""The ICVL hand posture data set (Tang et al., 2014): its files, and where its joints
lie on the model.

More than 300,000 training frames (the recorded ones and copies turned in the image plane) and
702 + 894 test frames of two sequences, 320 x 240, with 16 joints: the palm, and root, mid and tip
of each finger from the thumb on. There is a folder per split, with the folder Depth and text
files of joints.

Files, pictures and joints are as published. ICVL shows the mirror image of NYU's hand; the skeleton
``prototxt/hand/icvl.prototxt`` is the mirrored one.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.model import FINGERS
from handpose.datasets.published_frames import Flaw, PublishedFrames, check_frames, read_centers
from handpose.frames.cameras import ICVL
from handpose.frames.images import WRONG_SIZE, BadFrameError, read_png
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import read_text

MIN_TRAIN_FRAMES = 300_000  # at least
TEST_SEQUENCE_FRAMES = (702, 894)  # numbers of frames of the two test sequences

ICVL_CUBE_MM = 250.0  # edge of the cube around the hand
PALM_JOINT = 0  # the palm, at which crops are centred unless other centres are given

JOINTS = ("palm", *(f"{finger}_{part}" for finger in FINGERS for part in ("root", "mid", "tip")))

LABEL_FILES: dict[str, tuple[str, ...]] = {
    "train": ("Training/labels.txt",),
    "test": ("Testing/test_seq_1.txt", "Testing/test_seq_2.txt"),
}


def read_icvl_depth(path: str | Path) -> NDArray[np.float32]:
    """Depth (240, 320) in mm of one frame, a 16-bit grey image; 0 where nothing was read.

    Raises BadFrameError.
    """
    image = read_png(path)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise BadFrameError(
            path, WRONG_SIZE, f"found {image.dtype} of shape {image.shape}, expected 16-bit grey"
        )
    return image.astype(np.float32)


class IcvlAnnotation(NamedTuple):
    """The joints of one split."""

    files: list[Path]  # depth images, N
    uvd: Array  # (N, 16, 3) px, px, mm


def read_annotation(paths: Sequence[Path]) -> IcvlAnnotation:
    """The joints of some files, one after the other. Raises DataError.

    Each line is the path of an image below Depth/, and 16 times u v d.
    """
    files: list[Path] = []
    rows: list[Array] = []
    for path in paths:
        for number, line in enumerate(read_text(path, "the labels").split("\n"), 1):
            words = line.split()
            if words:
                files.append(path.parent / "Depth" / words[0].replace("\\", "/").lstrip("/"))
                rows.append(_joints(words[1:], f"{path}:{number}"))
    if not files:
        raise DataError(f"{paths[0]}: no labels in it")
    uvd = np.stack(rows)
    u, v, d = np.nanmedian(uvd[:, PALM_JOINT], axis=0)
    if not (ICVL.has_pixel(u, v) and 50 < d < 5000):
        raise DataError(
            f"{paths[0]}: the palm is mostly at {u:g} {v:g} {d:g}, expected u v d: pixels of an image "
            f"{ICVL.width} x {ICVL.height}, and mm"
        )
    return IcvlAnnotation(files, uvd)


def _joints(words: list[str], where: str) -> Array:
    """The joints (16, 3) of one line. Raises DataError."""
    count = 3 * len(JOINTS)
    found = f"{len(words)} values"
    if len(words) == count:
        try:
            return np.array(words, np.float64).reshape(-1, 3)
        except ValueError:
            found = "something that is not a number"
    raise DataError(
        f"{where}: found {found} after the path, expected {count} numbers, u v d of 16 joints"
    )


def read_split(root: Path, split: str, centers: Path | None = None) -> PublishedFrames:
    """The frames of a split.

    ``centers`` is a file of crop centres; without it the palm. Raises DataError.
    """
    paths = [root / name for name in LABEL_FILES[split]]
    there = [path for path in paths if path.is_file()]
    if not there:
        raise DataError(
            f"{paths[0]}: no such file; it holds the joints, and comes with the folder Depth"
        )
    annotation = read_annotation(there)
    count = len(annotation.files)
    center_uvd, centre = annotation.uvd[:, PALM_JOINT], "annotated palm"
    if centers is not None:
        center_uvd, centre = read_centers(centers, count)
    return PublishedFrames(
        split=split,
        files=annotation.files,
        center_uvd=center_uvd,
        joints=ICVL.unproject(annotation.uvd),
        cube_mm=np.full(count, ICVL_CUBE_MM),
        camera=ICVL,
        read=read_icvl_depth,
        made_from="ICVL",
        centre=centre,
    )


def check_split(root: Path, split: str) -> tuple[list[str], list[Flaw]]:
    """The content of a split, and its errors, one line each."""
    paths = [root / name for name in LABEL_FILES[split]]
    missing = [path for path in paths if not path.is_file()]

    def whole(count: int) -> list[Flaw]:
        texts = [
            f"{path}: no such file; the test frames of one of the two sequences are missing"
            for path in missing
        ]
        if split == "train" and count < MIN_TRAIN_FRAMES:
            texts.append(
                f"{paths[0]}: {count} labelled frames, the whole training set with its turned copies has over "
                "300,000"
            )
        if split == "test" and not missing and count != sum(TEST_SEQUENCE_FRAMES):
            texts.append(
                f"{paths[0].parent}: {count} labelled frames, the whole test set has {TEST_SEQUENCE_FRAMES[0]} + "
                f"{TEST_SEQUENCE_FRAMES[1]}"
            )
        return [Flaw(text, fatal=False) for text in texts]

    holds = f"{paths[0].name} and Depth"
    return check_frames(root, paths[0].parent, holds, lambda: read_split(root, split), whole)
