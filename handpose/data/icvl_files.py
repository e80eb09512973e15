"""What is particular to the ICVL hand posture data set (Tang et al., 2014).

More than 300,000 training frames (the recorded ones and copies turned in the image plane) and 702 + 894 test frames
of two sequences, 320 x 240, with 16 joints: the palm, and root, mid and tip of each finger from the thumb on.

ICVL shows the mirror image of NYU's hand. Files, pictures and joints here are as published; the skeleton
(``prototxt/hand/icvl.prototxt``) is the mirrored one.
"""

from __future__ import annotations

import array
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.annotated import (
    WRONG_SIZE,
    Annotated,
    BadFrameError,
    Problem,
    read_centers,
    read_png,
    recognise,
)
from handpose.camera import ICVL
from layers import kinematics
from netlib.errors import DataError, reason_of
from netlib.paths import names_in

Array = NDArray[np.float64]

CUBE_MM = 250.0  # edge of the cube around the hand
CENTER_JOINT = 0  # the palm, at which crops are centred unless other centres are given
TEST_FRAMES = (702, 894)  # of the two test sequences
TRAIN_FRAMES = 300_000  # at least
FINGERS = ("thumb", "index", "middle", "ring", "little")
JOINTS = ("palm", *(f"{finger}_{part}" for finger in FINGERS for part in ("root", "mid", "tip")))

# For each joint, the one or two joints of the model's 31 in whose middle it is. A "tip" of ICVL lies in the last
# phalanx: along NYU's fingers, scaled to ICVL's, it is the DIP point, and not the tip.
MODEL_JOINTS: dict[str, tuple[str, ...]] = {"palm": ("palm",)}
for _finger in FINGERS[1:]:
    MODEL_JOINTS[f"{_finger}_root"] = (f"{_finger}_base",)
    MODEL_JOINTS[f"{_finger}_mid"] = (f"{_finger}_pip_a", f"{_finger}_pip_b")
    MODEL_JOINTS[f"{_finger}_tip"] = (f"{_finger}_dip",)
MODEL_JOINTS |= {"thumb_root": ("thumb_pip",), "thumb_mid": ("thumb_dip",), "thumb_tip": ("thumb_tip",)}

LABELS: dict[str, tuple[str, ...]] = {
    "train": ("Training/labels.txt",),
    "test": ("Testing/test_seq_1.txt", "Testing/test_seq_2.txt"),
}


def from_model_joints(joints: ArrayLike) -> Array:
    """The 16 joints (N, 16, 3) among the model's 31 (N, 31, 3). They are still NYU's hand: mirror x for ICVL's."""
    name = kinematics.load().joint_names.index
    joints = np.asarray(joints, dtype=np.float64)
    return np.stack([joints[:, [name(j) for j in MODEL_JOINTS[own]]].mean(axis=1) for own in JOINTS], axis=1)


def read_icvl_depth(path: str | Path) -> NDArray[np.float32]:
    """Depth (240, 320) in mm of one frame, a 16-bit grey image; 0 where nothing was read. Raises BadFrameError."""
    image = read_png(path)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise BadFrameError(path, WRONG_SIZE, f"found {image.dtype} of shape {image.shape}, expected 16-bit grey")
    return image.astype(np.float32)


class Labels(NamedTuple):
    """The annotation of one split."""

    files: list[Path]  # depth images, N
    uvd: Array  # (N, 16, 3) px, px, mm


def read_labels(paths: Sequence[Path]) -> Labels:
    """The labels of some files, one after the other. Raises DataError.

    Each line is the path of an image below Depth/, and 16 times u v d.
    """
    files: list[Path] = []
    values = array.array("d")
    for path in paths:
        try:
            with path.open(encoding="utf-8") as lines:
                for number, line in enumerate(lines, 1):
                    words = line.split()
                    if words:
                        files.append(path.parent / "Depth" / words[0].replace("\\", "/").lstrip("/"))
                        _append(values, words[1:], f"{path}:{number}")
        except (OSError, UnicodeDecodeError) as error:
            raise DataError(f"{path}: cannot read the labels: {reason_of(error)}") from None
    uvd = np.frombuffer(values, dtype=np.float64).reshape(-1, len(JOINTS), 3)
    if not files:
        raise DataError(f"{paths[0]}: no labels in it")
    u, v, d = np.nanmedian(uvd[:, CENTER_JOINT], axis=0)
    if not (0 <= u < ICVL.width and 0 <= v < ICVL.height and 50 < d < 5000):
        raise DataError(f"{paths[0]}: the palm is mostly at {u:g} {v:g} {d:g}, expected u v d: pixels of an image "
                        f"{ICVL.width} x {ICVL.height}, and mm")  # fmt: skip
    return Labels(files, uvd)


def _append(values: array.array[float], words: list[str], where: str) -> None:
    """The joints of one line. Raises DataError."""
    count = 3 * len(JOINTS)
    try:
        if len(words) != count:
            raise ValueError
        values.extend([float(word) for word in words])
    except ValueError:
        found = f"{len(words)} values" if len(words) != count else "something that is not a number"
        raise DataError(
            f"{where}: found {found} after the path, expected {count} numbers, u v d of 16 joints"
        ) from None


def annotated(root: Path, split: str, centers: Path | None = None) -> Annotated:
    """The frames of a split. ``centers`` is a file of crop centres; without it the palm. Raises DataError."""
    labels = read_labels([path for path in (root / name for name in LABELS[split]) if path.is_file()])
    count = len(labels.files)
    return Annotated(
        split=split,
        files=labels.files,
        center_uvd=labels.uvd[:, CENTER_JOINT] if centers is None else read_centers(centers, count),
        joints=ICVL.unproject(labels.uvd),
        cube_mm=np.full(count, CUBE_MM),
        camera=ICVL,
        read=read_icvl_depth,
        made_from="ICVL",
        centre="annotated palm" if centers is None else f"centres of {centers.name}",
    )


def check(root: Path, split: str) -> tuple[list[str], list[Problem]]:
    """What is there of a split, and what is wrong with it, a line each."""
    if not root.is_dir():
        return [], [Problem(f"{root}: no such folder")]
    paths = [root / name for name in LABELS[split]]
    there = [path for path in paths if path.is_file()]
    folder = paths[0].parent
    if not there:
        return [], [Problem(_no_labels(root, folder, paths[0]))]
    try:
        labels = read_labels(there)
    except DataError as error:
        return [f"{folder}: no readable labels"], [Problem(str(error))]
    problems = [
        Problem(f"{path}: no such file; the test frames of one of the two sequences are missing", fatal=False)
        for path in paths
        if path not in there
    ]
    count = len(labels.files)
    if split == "train" and count < TRAIN_FRAMES:
        text = f"{there[0]}: {count} labelled frames, the whole training set with its turned copies has over 300,000"
        problems.append(Problem(text, fatal=False))
    if split == "test" and len(there) == 2 and count != sum(TEST_FRAMES):
        text = f"{folder}: {count} labelled frames, the whole test set has {TEST_FRAMES[0]} + {TEST_FRAMES[1]}"
        problems.append(Problem(text, fatal=False))
    names = {parent: names_in(parent) for parent in {path.parent for path in labels.files}}
    missing = [path for path in labels.files if path.name not in names[path.parent]]
    if missing:
        text = f"{folder}: {len(missing)} of {count} depth frames are missing, the first is {missing[0]}"
        problems.append(Problem(text, fatal=len(missing) == count))
    else:
        problems += _first_frame(labels.files[0])
    return [f"{folder}: {count} labelled frames, {count - len(missing)} of their depth frames"], problems


def _no_labels(root: Path, folder: Path, labels: Path) -> str:
    if folder.is_dir():
        return f"{labels}: no such file; it holds the joints, and comes with the folder Depth beside it"
    held = recognise(root)
    if held == "the ICVL data set":
        return f"{root}: no folder {folder.name!r}; the data set has Training and Testing"
    if (root / "Depth").is_dir() or (root / labels.name).is_file():
        return f"{root}: is itself a split; give the folder above it, which holds Training and Testing"
    advice = "; use tools/prepare_nyu.py" if held and "NYU" in held else ""
    told = f"looks like {held}{advice}" if held else "does not look like any data set known here"
    return f"{root}: no folder {folder.name!r} with ICVL labels; it {told}"


def _first_frame(path: Path) -> list[Problem]:
    try:
        shape = read_icvl_depth(path).shape
    except BadFrameError as error:
        return [Problem(str(error), fatal=error.kind == WRONG_SIZE)]
    if shape != (ICVL.height, ICVL.width):
        return [Problem(f"{path}: {shape[1]} x {shape[0]} pixels, expected {ICVL.width} x {ICVL.height}")]
    return []
