"""Files with the camera of frames that lie near them: camera.json, and where other
programs write theirs.

Recorders and data sets put them into the folder of the frames, one folder up, as Open3D's
camera_intrinsic.json next to depth/ and color/, or into a folder beside, as ScanNet's
intrinsic/intrinsic_depth.txt.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from handpose.frames.camera_file import COLOUR, NAME, rank_of, read
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from netlib.files.paths import exists, names_in, real

# Names of files, without their suffix, that tell of a camera, and others that may hold one near the
# frames. Folders with such a name may hold one in any text.
CERTAIN = re.compile(
    r".*(intrin|calib|camchain|rsenumerate).*|(scene|depth|ir)?cam(era)?s?(info|matrix|mat|param\w*|k)|ost",
    re.I,
)
POSSIBLE = re.compile(
    r"(scene|depth|ir)?cam(era)?s?(depth|ir|data|\d)?|k(depth|ir)?|sensor|info|meta(data)?|transforms|param(eter)?s|config"
    r"|.*(realsense|kinect|orbbec).*",
    re.I,
)
TEXTS = (
    ".json",
    ".yaml",
    ".yml",
    ".txt",
    ".ini",
    ".csv",
    ".cfg",
    ".cal",
)  # in a folder of such a name
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
FRAMES = (*PICTURES, ".npy", ".npz", ".raw")
MAX_FOLDERS = 100  # in which a camera is looked for
MAX_SHOWN = 3  # files in a message


def next_to(source: Path, is_needed: bool = True) -> CameraInfo:
    """What the files near a recording say of its camera: its camera.json, and others if the camera
    ``is_needed``.

    Of a file that was found and not used, ``doubt`` has the reason. Raises DataError for
    a camera.json.
    """
    said = next((read(place) for place in _own_places(source) if exists(place)), CameraInfo())
    if said.camera is not None or not is_needed:
        return said
    doubts: list[str] = []
    for places in _levels(source):
        found = _best(places, doubts)
        if found is not None:
            return said.or_else(found)
    return replace(said, doubt="; ".join(doubts[:MAX_SHOWN]))


def places_next_to(source: Path) -> list[Path]:
    """The paths of the files that ``next_to`` reads, the most specific first."""
    return [*_own_places(source), *(path for places in _levels(source) for path in places)]


def _own_places(source: Path) -> list[Path]:
    return (
        [source / NAME]
        if source.is_dir()
        else [source.with_suffix(f".{NAME}"), source.with_name(NAME)]
    )


def _levels(source: Path) -> Iterator[list[Path]]:
    """The files that may hold a camera, from the nearest folder to the farthest."""
    if not source.is_dir():
        yield _named(source.parent, CERTAIN, POSSIBLE)
        return
    above = source.parent if source.name else real(source).parent
    yield _named(source, CERTAIN, POSSIBLE)
    yield _named(above, CERTAIN, POSSIBLE)
    yield [path for folder in (source, above) for path in _in_folders_of(folder, source)]


def _named(folder: Path, *kinds: re.Pattern[str]) -> list[Path]:
    """The files of a folder with a name of one of these kinds; not the camera.json of a file,
    NAME.camera.json.
    """
    names = [name for name in sorted(names_in(folder)) if _is_named(name, *kinds)]
    return [folder / name for name in names if (folder / name).is_file()]


def _is_named(name: str, *kinds: re.Pattern[str]) -> bool:
    stem, _, suffix = name.rpartition(".")
    plain = re.sub(r"[\W_]", "", stem or suffix)
    is_picture = name.lower().endswith(PICTURES) or name.startswith(".")
    return not is_picture and any(kind.fullmatch(plain) for kind in kinds)


def _in_folders_of(folder: Path, source: Path) -> Iterator[Path]:
    """Files in the folders of a folder, except in those with frames, which are other recordings."""
    inner = [folder / name for name in sorted(names_in(folder)) if not name.startswith(".")]
    for beside in [path for path in inner if path.is_dir() and path != source][:MAX_FOLDERS]:
        names = sorted(names_in(beside))
        if _is_named(beside.name, CERTAIN, POSSIBLE):
            yield from _named(beside, CERTAIN, POSSIBLE)
            others = [name for name in names if not _is_named(name, CERTAIN, POSSIBLE)]
            yield from (beside / name for name in others if name.lower().endswith(TEXTS))
        elif not any(name.lower().endswith(FRAMES) for name in names):
            yield from _named(beside, CERTAIN)


def _best(places: list[Path], doubts: list[str]) -> CameraInfo | None:
    """The camera in the files of a level, of depth before others; None without one.

    Others are added to ``doubts``.
    """
    found: list[tuple[int, CameraInfo]] = []
    for path in places:
        rank = rank_of(path.parent.name, path.stem)
        try:
            info = read(path)
        except DataError as error:
            doubts.append(str(error))
            continue
        if info.camera is None or rank == COLOUR:
            doubts.append(
                f"{path}: {'no camera' if info.camera is None else 'the camera of colours'}"
            )
        else:
            found.append((rank, info))
    best = [info for rank, info in found if rank == min(found, key=lambda one: one[0])[0]]
    if len({replace(info, origin="") for info in best}) > 1:
        doubts.insert(0, f"{' and '.join(info.origin for info in best)} are different cameras")
        return None
    return best[0] if best else None
