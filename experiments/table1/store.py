"""The results store of Table 1: one small JSON file for each scored length of a training run.

    docs/results/table1/one_hand/ours_paper_seed1_4000.json

It has everything that the page and the pictures need. Its training runs are never repeated, whether their snapshots
exist or not. ``shown.json`` in the same folder has the frames that are drawn: their crops, and the true joints.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.body import nyu
from handpose.frames.json_fields import Fields, parsed
from netlib import files
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import atomic

JOINTS, ROTATIONS = len(nyu.ANNOTATION_OF_JOINT), 23  # numbers of joints and rotations of the hand
THRESHOLDS_MM = range(0, 81, 2)  # abscissae of the success curve
DRAWN = 4  # number of drawn frames
DECIMALS = 4
WHERE = "shown.json"


@dataclass(frozen=True)
class Figures:
    """The scores of a network on the frames of one test subject; NaN for missing scores."""

    subject: str
    frames: int
    error_14_mm: float
    error_mm: float
    angle_deg: float  # mean over the rotations, against the exact angles
    fitted_angle_deg: float  # the same against those of the hand fitted to the true joints
    out_of_limits: float  # fraction of the frames
    within_40_mm: float
    own_bones_mm: float  # error_14_mm with the predicted angles on the frame's own bones
    scaled_mm: float  # ... or the hand's bones, made as large as the frame's by one factor
    joints_mm: Sequence[float]  # mean by joint
    success: Sequence[float]  # fraction of the frames whose worst of the 14 joints is within THRESHOLDS_MM
    angles_deg: Sequence[float]  # mean by rotation, against the exact angles if known, otherwise the fitted


@dataclass(frozen=True)
class Entry:
    """One length of a training run."""

    setting: str
    network: str
    recipe: str
    seed: int
    iterations: int
    error_mm: float  # over the 14 joints and all test frames: it decides whether to train longer
    seconds: float  # training time, trunk and end
    threads: int
    machine: str
    data: str  # description of the frames
    made_from: str
    command: str
    subjects: Sequence[Figures]  # the training subject first
    shown: Array  # (DRAWN, JOINTS, 3) that it predicts for the frames that are drawn, half-cubes

    @property
    def key(self) -> tuple[str, str, str, int, int]:
        """The key of the entry."""
        return self.setting, self.network, self.recipe, self.seed, self.iterations


@dataclass(frozen=True)
class Shown:
    """The frames of a setting that are drawn."""

    numbers: Sequence[int]
    half_cube: Array  # (DRAWN,) mm
    truth: Array  # (DRAWN, JOINTS, 3) half-cubes
    crops: Sequence[NDArray[np.float32]]


def path_of(folder: Path, setting: str, network: str, recipe: str, seed: int, iterations: int) -> Path:
    """The path of an entry."""
    return folder / setting / f"{network}_{recipe}_seed{seed}_{iterations}.json"


def write(folder: Path, entry: Entry) -> Path:
    """Write an entry atomically; returns its path. Raises OSError."""
    path = path_of(folder, *entry.key)
    atomic.replace_bytes(path, _text(asdict(entry)))
    return path


def read_all(folder: Path, setting: str) -> list[Entry]:
    """All entries of a setting. Raises DataError for a file that is damaged, not where it belongs, or of other data."""
    entries = [read(path) for path in sorted((folder / setting).glob("*_seed*.json"))]
    for entry in entries:
        if entry.data != entries[0].data:
            raise DataError(f"{path_of(folder, *entry.key)}: was made with the data {entry.data!r}, "
                            f"{path_of(folder, *entries[0].key).name} with {entries[0].data!r}")
    return entries


def read(path: Path) -> Entry:
    """One entry. Raises DataError."""
    of = _fields(path)
    entry = Entry(
        setting=of.text("setting"), network=of.text("network"), recipe=of.text("recipe"), seed=of.whole("seed"),
        iterations=of.whole("iterations", 1), error_mm=of.number("error_mm", 0), seconds=of.number("seconds", 0),
        threads=of.whole("threads", 1), machine=of.text("machine"), data=of.text("data"),
        made_from=of.text("made_from"), command=of.text("command"),
        subjects=[_figures(part) for part in of.parts("subjects")], shown=of.numbers("shown", DRAWN, JOINTS, 3),
    )
    if not entry.subjects:
        raise DataError(f"{path}: 'subjects' is empty, expected the figures of one at least")
    if path_of(path.parent.parent, *entry.key) != path:
        raise DataError(f"{path}: holds what belongs to {path_of(Path(), *entry.key)}; was it renamed?")
    return entry


def write_shown(folder: Path, setting: str, shown: Shown) -> None:
    """Write the frames that are drawn. Raises OSError."""
    crops = [base64.b64encode(cv2.imencode(".png", _grey(crop))[1].tobytes()).decode() for crop in shown.crops]
    frames = [{"number": int(number), "crop": crop} for number, crop in zip(shown.numbers, crops)]
    content = {"frames": frames, "half_cube": shown.half_cube, "truth": shown.truth}
    atomic.replace_bytes(folder / setting / WHERE, _text(content))


def read_shown(folder: Path, setting: str) -> Shown:
    """The frames that are drawn. Raises DataError."""
    path = folder / setting / WHERE
    of = _fields(path)
    frames, half_cube = list(of.parts("frames")), of.numbers("half_cube", DRAWN)
    if len(frames) != DRAWN or half_cube.min() <= 0:
        raise DataError(f"{path}: {len(frames)} frames, half-cubes from {half_cube.min():g} mm; expected {DRAWN}, and "
                        "half-cubes above 0")
    return Shown([frame.whole("number") for frame in frames], half_cube, of.numbers("truth", DRAWN, JOINTS, 3),
                 [_crop(frame, path) for frame in frames])


def _fields(path: Path) -> Fields:
    return Fields(parsed(files.read_text(path, "the results of Table 1"), str(path)), str(path))


def _figures(of: Fields) -> Figures:
    return Figures(
        subject=of.text("subject"), frames=of.whole("frames", 1), error_14_mm=of.number("error_14_mm", 0),
        error_mm=of.number("error_mm", 0), angle_deg=of.known("angle_deg", 0),
        fitted_angle_deg=of.known("fitted_angle_deg", 0), out_of_limits=of.known("out_of_limits", 0, 1),
        within_40_mm=of.number("within_40_mm", 0, 1), own_bones_mm=of.known("own_bones_mm", 0),
        scaled_mm=of.known("scaled_mm", 0),
        joints_mm=of.numbers("joints_mm", JOINTS).tolist(), success=of.numbers("success", len(THRESHOLDS_MM)).tolist(),
        angles_deg=of.numbers("angles_deg", ROTATIONS).tolist(),
    )


def _text(values: Any) -> bytes:
    """JSON, rounded; a list of numbers is on one line, so that two runs can be compared line by line."""
    plain = _plain(values)
    lines = ",\n".join(f" {json.dumps(name)}: {json.dumps(value)}" for name, value in plain.items())
    return f"{{\n{lines}\n}}\n".encode()


def _plain(value: Any) -> Any:
    """As JSON has it: rounded numbers, null for NaN."""
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(part) for part in value]
    if isinstance(value, (float, np.floating)):
        return round(float(value), DECIMALS) if math.isfinite(value) else None
    return value


def _grey(crop: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A crop in [-1, 1] in 8 bits, for display."""
    return np.round((crop + 1) * 127.5).astype(np.uint8)


def _crop(frame: Fields, path: Path) -> NDArray[np.float32]:
    try:
        coded = np.frombuffer(base64.b64decode(frame.text("crop"), validate=True), np.uint8)
    except ValueError:
        raise DataError(f"{path}: a crop is not whole") from None
    image = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE) if len(coded) else None
    if image is None:
        raise DataError(f"{path}: a crop is not a picture")
    return np.asarray(image, np.float32) / np.float32(127.5) - 1
