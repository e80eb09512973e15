"""Any source of depth frames by its name.

with open_recording("frames") as recording:      # a folder, frames/left_*.png, take.npz, take.bag, realsense ...
    for frame in recording: ...
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from handpose.frames.raw import HEADERLESS
from handpose.frames.recording import UNKNOWN, CameraInfo, Recording
from netlib.errors import DataError
from netlib.files.paths import exists

STACKS, VIDEOS, BAGS = (".npy", ".npz", ".h5", ".hdf5"), (".mkv", ".avi", ".mp4", ".mov"), (".bag", ".db3", ".mcap")
PICTURES = (".png", ".tif", ".tiff", ".bin")
LIVE = ("realsense", "orbbec", "oak", "ros2")
EXPECTED = (f"a folder of 16-bit PNG, FOLDER/NAME_*.png, {', '.join((*STACKS, *VIDEOS, *BAGS))}, or a camera that is "
            "connected: realsense, orbbec or oak, each with or without :SERIAL, or ros2:TOPIC")


def open_recording(source: str | Path, given: CameraInfo = UNKNOWN) -> Recording:
    """The recording in a folder or a file, or a live camera.

    given  camera parameters from the user; unknown ones are taken from the source itself, then from a camera.json

    Raises DataError, and NetlibError if the source needs a package that is missing.
    """
    name, path = str(source), Path(source)
    if (kind := name.partition(":")[0]) in LIVE and not exists(path):
        _refuse_time_unit(name, given)
        return _live(kind)(name.partition(":")[2] or None, given)
    file = path if exists(path) else Path(name.partition("#/")[0])  # a bag's topic may follow
    suffix = file.suffix.lower()
    if exists(file) and file.is_dir():
        suffix = BAGS[1] if (file / "metadata.yaml").is_file() else PICTURES[0]  # a bag of ROS 2 is a folder
    elif not exists(file) and suffix in (*STACKS, *VIDEOS, *BAGS):
        raise DataError(f"{source}: no such file")
    if suffix in STACKS:
        from handpose.frames.formats.stack import open_stack

        return open_stack(path, given)
    if suffix in (*VIDEOS, *BAGS):
        _refuse_time_unit(name, given)
    if suffix in VIDEOS:
        from handpose.frames.formats.video import open_video

        return open_video(path, given)
    if suffix in BAGS:
        from handpose.frames.formats.ros_bag import open_bag

        return open_bag(path, given)
    if suffix in PICTURES or not exists(path):
        from handpose.frames.formats.folder import open_folder

        return open_folder(path, given)
    if suffix == ".raw":
        raise DataError(f"{source}: {HEADERLESS}")
    raise DataError(f"{source}: not a recording; expected {EXPECTED}")


def _live(kind: str) -> Callable[[str | None, CameraInfo], Recording]:
    """The function that opens a camera of this kind."""
    if kind == "realsense":
        from handpose.frames.formats import realsense

        return realsense.open_live
    if kind == "orbbec":
        from handpose.frames.formats import orbbec

        return orbbec.open_live
    if kind == "oak":
        from handpose.frames.formats import oak

        return oak.open_live
    from handpose.frames.formats import ros2

    return ros2.open_live


def _refuse_time_unit(source: str, given: CameraInfo) -> None:
    if given.time_unit is not None:
        raise DataError(f"{source}: its times have a unit; --time-unit is for the names of images and for arrays")
