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
from itertools import islice
from pathlib import Path

from handpose.frames.camera_file import NAME, read
from handpose.frames.camera_keys import COLOUR, rank_of
from handpose.frames.camera_search import OF_COLOURS
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from netlib.files.paths import exists, names_in, real

# Names of files, without what is no letter or digit before the suffix: those that tell of a camera;
# with others that may hold one near the frames; with all texts in folders of such a name; frames.
CERTAIN = (
    r".*(intrin|calib|camchain|rsenumerate).*"
    r"|((scene|depth|ir)?cam(era)?s?(info|matrix|mat|param\w*|k)|ost)(\.[^.]*)?"
)
POSSIBLE = (
    rf"{CERTAIN}|((scene|depth|ir)?cam(era)?s?(depth|ir|data|\d)?|k(depth|ir)?|sensor|info|meta(data)?"
    r"|transforms|param(eter)?s|config)(\.[^.]*)?|.*depthmetadata(\.[^.]*)?|.*(realsense|kinect|orbbec).*"
)
TEXTS = rf"{POSSIBLE}|.*\.(json|ya?ml|txt|ini|csv|cfg|cal)"
PICTURE_NAMES = r".*\.(png|jpe?g|tiff?|bmp)"
FRAME_NAMES = rf"{PICTURE_NAMES}|.*\.(npy|npz|raw)"
MAX_FOLDERS = 100  # in which a camera is looked for
MAX_DOUBTS = 3  # files in a message


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
        if found := _best(places, doubts):
            return said.or_else(found[0])
    return replace(said, doubt="; ".join(doubts[:MAX_DOUBTS]))


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
        yield [*_named(source.parent, POSSIBLE)]
        return
    above = source.parent if source.name else real(source).parent
    yield [*_named(source, POSSIBLE)]
    yield [*_named(above, POSSIBLE)]
    yield [path for folder in (source, above) for path in _in_folders_of(folder, source)]


def _matches(path: Path, kind: str) -> bool:
    plain = re.sub(r"[\W_]", "", path.stem) + path.suffix
    return re.fullmatch(kind, plain, re.I) is not None


def _named(folder: Path, kind: str) -> Iterator[Path]:
    """The files of a folder with a name of a kind but pictures; not the camera.json of a file,
    NAME.camera.json.
    """
    for path in _inside(folder):
        if _matches(path, kind) and not _matches(path, PICTURE_NAMES) and path.is_file():
            yield path


def _inside(folder: Path) -> Iterator[Path]:
    return (folder / name for name in sorted(names_in(folder)) if not name.startswith("."))


def _in_folders_of(folder: Path, source: Path) -> Iterator[Path]:
    """Files in the folders of a folder, except in those with frames, which are other recordings."""
    folders = (path for path in _inside(folder) if path.is_dir() and path != source)
    for beside in islice(folders, MAX_FOLDERS):
        if _matches(beside, POSSIBLE):
            yield from _named(beside, TEXTS)
        elif not any(_matches(path, FRAME_NAMES) for path in _inside(beside)):
            yield from _named(beside, CERTAIN)


def _best(places: list[Path], doubts: list[str]) -> list[CameraInfo]:
    """The camera in the files of a level, of depth before others, as each file has it.

    Others are added to ``doubts``.
    """
    ranked: dict[int, list[CameraInfo]] = {}
    for path in places:
        rank = rank_of(path.parent.name, path.stem)
        try:
            info = read(path)
        except DataError as error:
            doubts.append(str(error).partition("; known: ")[0])
            continue
        if info.camera is None:
            doubts.append(f"{path}: no camera")
        elif info.doubt or rank == COLOUR:
            doubts.append(f"{path}: {OF_COLOURS}")
        else:
            ranked.setdefault(rank, []).append(info)
    best = ranked.get(min(ranked, default=COLOUR), [])
    if len({replace(info, origin="") for info in best}) > 1:
        origins = " and ".join(info.origin for info in best)
        doubts.insert(0, f"{origins} are different cameras")
        return []
    return best
