"""Find the camera among the objects of a document: of several that of the depth, and of several
modes of it one for each size of frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from handpose.frames.camera_keys import COLOUR, INTRINSICS, SIZE, has_camera, numbers_in, rank_of
from handpose.frames.camera_object import Chain, FoundCamera, read_camera, shown
from handpose.frames.cameras import Camera, View
from handpose.frames.lens import Lens
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError

MIDDLE = (0.3, 0.7)  # range of a principal point, as a share of the size
OF_COLOURS = "the camera of colours"


def find(document: Any, where: str, is_replaced: bool = False) -> FoundCamera:
    """The camera in a document of plain values; ``where`` begins errors.

    is_replaced  whether the user gives the camera, so that the document's matrix need not be valid

    Raises DataError.
    """
    if not isinstance(document, dict):
        document = _of_numbers(document, where)
    chains = [chain for chain in _objects(document, []) if has_camera(chain[-1][1])]
    chains = chains or [[("", document)]]
    ranks = [_rank(chain) for chain in chains]
    best = min(ranks)
    chosen = [chain for chain, rank in zip(chains, ranks) if rank == best]
    found = [read_camera(chain, where, is_replaced) for chain in chosen]
    if all(rank_of(*(name for name, _ in chain)) == COLOUR for chain in chosen):
        found = [replace(one, info=replace(one.info, doubt=OF_COLOURS)) for one in found]
    if len({one.info for one in found}) == 1:
        return found[0]
    return replace(found[0], info=_of_modes(found, where))


def _of_numbers(document: Any, where: str) -> dict[str, Any]:
    """The object of a matrix, or of fx, fy, cx, cy, after or before which are width and height."""
    numbers = numbers_in(document)
    if not numbers:
        form = '{"fx": ..., "fy": ..., "u0": ..., "v0": ...}'
        raise DataError(f"{where}: found {shown(document)}; expected {form}")
    if len(numbers) == len(INTRINSICS) + len(SIZE):
        is_usual = _is_middle(numbers[2:4], numbers[4:])
        if not is_usual and _is_middle(numbers[4:], numbers[:2]):  # as in ARKitScenes
            return {"matrix": numbers[2:], "size": numbers[:2]}
        return {"matrix": numbers[:4], "size": numbers[4:]}
    return {"matrix": document}


def _is_middle(point: Sequence[float], size: Sequence[float]) -> bool:
    """Whether a point may be the principal point of images of a size."""
    low, high = MIDDLE
    return all(low * length < at < high * length for at, length in zip(point, size))


def _objects(value: Any, outer: Chain, name: str = "") -> Iterator[Chain]:
    """All objects in a value, each with those around it."""
    if isinstance(value, dict):
        inner = [*outer, (name, value)]
        yield inner
        for key, child in value.items():
            yield from _objects(child, inner, str(key))
    elif isinstance(value, list):
        for child in value:
            yield from _objects(child, outer, name)


def _rank(chain: Chain) -> int:
    """The rank of a camera, by the names around it and the texts in it."""
    names = [name for name, _ in chain]
    texts = map(str, chain[-1][1].values())
    return rank_of(*names, *texts)


def _of_modes(found: Sequence[FoundCamera], where: str) -> CameraInfo:
    """Cameras that have one size of frames each, and all else in common, as one.

    Raises DataError for others.
    """
    infos = dict.fromkeys(one.info for one in found)
    cameras = [info.camera for info in infos if isinstance(info.camera, Camera)]
    modes = {(camera.width, camera.height): camera for camera in cameras}
    has_size_each = len(modes) == len(infos) and (0, 0) not in modes
    common, *others = {replace(info, camera=None) for info in infos}
    if not has_size_each or others:
        names = ", ".join(dict.fromkeys(one.name for one in found))
        raise DataError(f"{where}: has several cameras: {names}; expected one, or one of depth")

    def at(width: int, height: int) -> Camera:
        if (width, height) not in modes:
            known = ", ".join(f"{w} x {h}" for w, h in modes)
            raise DataError(f"{width} x {height} pixels; {where} has a camera for {known}")
        return modes[width, height]

    # without a lens it would be one by its field of view
    view = View("own", at, tuple(modes))
    return replace(common, camera=view, lens=common.lens or Lens())
