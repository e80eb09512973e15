"""Any source of depth frames by its name, read by the module of its format.

# a folder, frames/left_*.png, take.npz, take.bag, realsense ...
with open_recording("frames") as recording:
    for frame in recording: ...
"""

from __future__ import annotations

from pathlib import Path

from handpose.frames.recording import UNKNOWN, CameraInfo, Recording
from netlib.errors import DataError
from netlib.files.paths import exists

STACKS, BAGS, PICTURES = (".npy", ".npz"), (".bag", ".db3", ".mcap"), (".png", ".tif", ".tiff")
LIVE = "realsense"
EXPECTED = (f"a folder of 16-bit PNG, FOLDER/NAME_*.png, {', '.join((*STACKS, *BAGS))}, or a camera that is "
            "connected: realsense or realsense:SERIAL")

_FROM_VIDEO = ("a video; expected 16-bit PNG or an .npz", (  # tools/record.py once wrote a camera.json as a tag CAMERA
    "import av, cv2, os; os.mkdir('frames'); v = av.open({name!r}); "
    "open('frames/camera.json', 'w').write(v.metadata.get('CAMERA', '{{}}')); "
    "[cv2.imwrite(f'frames/{{round(1000 * f.time):09d}}ms.png', f.to_ndarray()) for f in v.decode(video=0)]"
))
_FROM_HDF5 = ("HDF5; expected 16-bit PNG or an .npz",
              "import h5py, numpy; f = h5py.File({name!r}); "
              "numpy.savez('frames.npz', **f.attrs, **{{k: v[()] for k, v in f.items()}})")
# Kinds of files that are not read: what they are, and the Python statement that converts them. An .npy is read, but not
# several in a folder.
CONVERTED = {
    ".mkv": _FROM_VIDEO, ".avi": _FROM_VIDEO, ".h5": _FROM_HDF5, ".hdf5": _FROM_HDF5,
    ".npy": ("a file for each frame; they are joined to one array",
             "import glob, numpy as np; np.save('../take.npy', [np.load(name) for name in "
             "sorted(glob.glob('*.npy'))])"),
    ".raw": ("values without a header, as rs-convert -r and the RealSense Viewer write them; write PNG instead "
             "(rs-convert -p), or give their height and width",
             "import glob, numpy as np; np.save('take.npy', [np.fromfile(name, '<u2').reshape(480, 640) for name in "
             "sorted(glob.glob('*.raw'))])"),
}


def conversion(suffix: str, name: str = "") -> str:
    """What files of a kind in CONVERTED are, and the command that converts them."""
    what, statement = CONVERTED[suffix]
    return f'{what}; this converts: python -c "{statement.format(name=name)}"'


def open_recording(source: str | Path, given: CameraInfo = UNKNOWN) -> Recording:
    """The recording in a folder or a file, or a live camera.

    given  camera parameters from the user; unknown ones are taken from the source itself, then from a camera.json

    Raises DataError, and NetlibError if the source needs a package that is missing.
    """
    name, path = str(source), Path(source)
    if name.partition(":")[0] == LIVE and not exists(path):
        from handpose.frames.formats.realsense import open_live

        _refuse_time_unit(name, given)
        return open_live(name.partition(":")[2] or None, given)
    file = path if exists(path) else Path(name.partition("#/")[0])  # a bag's topic may follow
    suffix = file.suffix.lower()
    if exists(file) and file.is_dir():
        suffix = BAGS[1] if (file / "metadata.yaml").is_file() else PICTURES[0]  # a bag of ROS 2 is a folder
    elif not exists(file) and suffix in (*STACKS, *CONVERTED, *BAGS):
        raise DataError(f"{source}: no such file")
    if suffix in STACKS:
        from handpose.frames.formats.stack import StackRecording

        return StackRecording(path, given)
    if suffix in BAGS:
        _refuse_time_unit(name, given)
        from handpose.frames.formats.ros_bag import BagRecording

        return BagRecording(path, given)
    if suffix in PICTURES or not exists(path):
        from handpose.frames.formats.folder import FolderRecording

        return FolderRecording(path, given)
    if suffix in CONVERTED:
        raise DataError(f"{source}: {conversion(suffix, name)}")
    raise DataError(f"{source}: not a recording; expected {EXPECTED}")


def _refuse_time_unit(source: str, given: CameraInfo) -> None:
    if given.time_unit is not None:
        raise DataError(f"{source}: its times have a unit; --time-unit is for the names of images and for arrays")
