"""Any source of depth frames by its name, read by the module of its format.

# a folder, frames/left_*.png, take.npz, take.bag, realsense ...
with open_recording("frames") as recording:
    for frame in recording: ...
"""

from __future__ import annotations

import shlex
from pathlib import Path

from handpose.frames.recording import UNKNOWN, CameraInfo, Recording
from netlib.errors import DataError, NetlibError
from netlib.files.paths import exists

STACKS, BAGS, PICTURES, RAW = (
    (".npy", ".npz"),
    (".bag", ".db3", ".mcap"),
    (".png", ".tif", ".tiff"),
    ".raw",
)
OF_ONE_FRAME = (*PICTURES, *STACKS, RAW)  # kinds of files that are a frame each in a folder
LIVE = "realsense"
EXPECTED = (
    "a folder with a 16-bit PNG, .npy, .npz or .raw for each frame, FOLDER/NAME_*.png, "
    f"{', '.join((*STACKS, *BAGS))}, or a camera that is connected: realsense or realsense:SERIAL"
)

# Of several streams of 16 bits, infrared is one. tools/record.py once wrote a camera.json
# as a tag CAMERA.
_FROM_VIDEO = (
    "a video, which PyAV reads (pip install av); expected 16-bit PNG or an .npz",
    "import av, cv2, os, sys; v = av.open(sys.argv[1]); "
    "grey = [s for s in v.streams.video if 'gray16' in s.format.name] or sys.exit('no stream of 16-bit grey values'); "
    "depth = min(grey, key=lambda s: 'DEPTH' not in s.metadata.get('title', '').upper()); os.mkdir('frames'); "
    "open('frames/camera.json', 'w').write(v.metadata.get('CAMERA', '{}')); "
    "[cv2.imwrite(f'frames/{round(1000 * f.time):09d}ms.png', f.to_ndarray(format='gray16le')) "
    "for f in v.decode(depth)]",
)
_FROM_HDF5 = (
    "HDF5; expected 16-bit PNG or an .npz",
    "import h5py, numpy, sys; f = h5py.File(sys.argv[1]); d = dict(f.attrs); f.visititems(lambda k, v: "
    "d.update({k: v[()]} if hasattr(v, 'shape') else {}, **{f'{k}/{a}': x for a, x in v.attrs.items()})); "
    "numpy.savez(open('frames.npz', 'xb'), **{k.replace('/', '.'): v for k, v in d.items()})",
)
# Arrays (height, width, frames), as usual in MATLAB, remain so; the error for them has the remedy.
_FROM_MATLAB = (
    "MATLAB; expected 16-bit PNG or an .npz",
    "import h5py, numpy, sys; from scipy.io import loadmat; p = sys.argv[1]; "
    "d = {k: v[()].T for k, v in h5py.File(p).items() if hasattr(v, 'shape')} if h5py.is_hdf5(p) else loadmat(p); "
    "numpy.savez(open('frames.npz', 'xb'), **{k: numpy.array(v, order='C') for k, v in d.items() "
    "if k[0] not in '_#'})",
)
_FROM_PFM = (
    "PFM; expected 16-bit PNG or an .npy",
    "import cv2, numpy, os, pathlib, sys; os.mkdir('frames'); "
    "[numpy.save(f'frames/{p.stem}.npy', cv2.imread(str(p), -1)) "
    "for p in pathlib.Path(sys.argv[1]).parent.glob('*.pfm')]",
)
_FROM_PGM = (
    "PGM; expected 16-bit PNG (those of libfreenect's fakenect have exchanged bytes: add .byteswap() after -1))",
    "import cv2, os, pathlib, sys; os.mkdir('frames'); [cv2.imwrite(f'frames/{p.stem}.png', cv2.imread(str(p), -1)) "
    "for p in pathlib.Path(sys.argv[1]).parent.glob('*.pgm')]",
)
_FROM_ZIP = (
    "an archive; expected the folder in it",
    "import shutil, sys; shutil.unpack_archive(sys.argv[1], 'frames')",
)
# Kinds of files that are not read: what they are, and the Python statement that converts the file
# in sys.argv[1].
CONVERTED = {
    ".mkv": _FROM_VIDEO,
    ".avi": _FROM_VIDEO,
    ".h5": _FROM_HDF5,
    ".hdf5": _FROM_HDF5,
    ".mat": _FROM_MATLAB,
    ".pgm": _FROM_PGM,
    ".pfm": _FROM_PFM,
    ".zip": _FROM_ZIP,
}
FROM_OTHERS = (
    "of other formats write the depth with Python: numpy.savez('take.npz', depth=array), "
    "(frames, height, width)"
)


def conversion(path: Path) -> str:
    """What a file of a kind in CONVERTED is, and the command that converts it."""
    what, statement = CONVERTED[path.suffix.lower()]
    return f'{what}; this converts: python -c "{statement}" {shlex.quote(str(path))}'


def is_pattern(path: Path) -> bool:
    """Whether the name of a file that does not exist is a pattern of names."""
    return any(character in path.name for character in "*?[") and not exists(path)


def open_recording(source: str | Path, given: CameraInfo = UNKNOWN) -> Recording:
    """The recording in a folder or a file, or a live camera.

    given  camera parameters from the user; unknown ones are taken from the source itself, then
           from a camera.json

    Raises DataError, and NetlibError if the source needs a package that is missing.
    """
    if not isinstance(given, CameraInfo):
        what = type(given).__name__
        raise NetlibError(f"given is a {what}; expected a CameraInfo, such as CameraInfo(NYU)")
    name = str(source)
    if not name:
        raise DataError("the recording has no name; expected a folder, a file or a live camera")
    path = Path(source)
    if name.partition(":")[0] == LIVE and not exists(path):
        from handpose.frames.formats.realsense import open_live

        _refuse_time_unit(name, given)
        return open_live(name.partition(":")[2] or None, given)
    file = path if exists(path) else Path(name.partition("#/")[0])  # a bag's topic may follow
    suffix = file.suffix.lower()
    if exists(file) and file.is_dir():
        # a bag of ROS 2 is a folder
        suffix = BAGS[1] if (file / "metadata.yaml").is_file() else PICTURES[0]
    elif is_pattern(path):
        suffix = PICTURES[0]
    elif not exists(file) and suffix in (*STACKS, RAW, *CONVERTED, *BAGS):
        raise DataError(f"{source}: no such file")
    if suffix in STACKS:
        from handpose.frames.formats.stack import StackRecording

        return StackRecording(path, given)
    if suffix in BAGS:
        _refuse_time_unit(name, given)
        from handpose.frames.formats.ros_bag import BagRecording

        return BagRecording(path, given)
    if suffix in (*PICTURES, RAW) or not exists(path):
        from handpose.frames.formats.folder import FolderRecording

        return FolderRecording(path, given)
    if suffix in CONVERTED:
        raise DataError(f"{source}: {conversion(path)}")
    raise DataError(f"{source}: not a recording; expected {EXPECTED}; {FROM_OTHERS}")


def _refuse_time_unit(source: str, given: CameraInfo) -> None:
    if given.time_unit is not None:
        raise DataError(
            f"{source}: its times have a unit; --time-unit is for the names of images and for arrays"
        )
