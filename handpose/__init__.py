"""Hand pose from depth images: data sets, synthetic frames, predictors, fits, trackers
and their scores.

hand = handpose.load_predictor(handpose.KINECT2).in_frame(depth)
hand.xyz, hand.confidence

with handpose.open_recording("takes/wave") as recording:
    for frame in handpose.load_tracker(recording.camera).follow(recording):
        frame.hands

In the order in which a frame passes them: frames, body, datasets, fit, estimate, tracking, output.
Besides these, synthetic renders single frames, sequences renders recordings, and scoring compares
results with labels.
"""

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING

__version__ = "0.1.0"  # of the package: setup.cfg and 'handpose --version' read it here

if TYPE_CHECKING:
    from handpose.estimate.packaged import load_predictor as load_predictor
    from handpose.frames.cameras import CAMERAS as CAMERAS
    from handpose.frames.cameras import ICVL as ICVL
    from handpose.frames.cameras import KINECT2 as KINECT2
    from handpose.frames.cameras import MSRA15 as MSRA15
    from handpose.frames.cameras import NYU as NYU
    from handpose.frames.cameras import SR305 as SR305
    from handpose.frames.cameras import Camera as Camera
    from handpose.frames.formats import open_recording as open_recording
    from handpose.frames.lens import Lens as Lens
    from handpose.frames.live import DeviceFrame as DeviceFrame
    from handpose.frames.live import open_device as open_device
    from handpose.frames.recording import CameraInfo as CameraInfo
    from handpose.frames.recording import DepthFrame as DepthFrame
    from handpose.frames.recording import Recording as Recording
    from handpose.frames.writing import RecordingWriter as RecordingWriter
    from handpose.output.tracks.json_file import Track as Track
    from handpose.output.tracks.json_file import read_track as read_track
    from handpose.tracking.tracker import Tracker as Tracker
    from handpose.tracking.tracker import load_tracker as load_tracker

_OURS = [Path(__file__).resolve().parents[1] / name / "__init__.py" for name in ("layers", "fast")]
_FOUND = [importlib.util.find_spec(path.parent.name) for path in _OURS]
if any(spec and spec.origin and Path(spec.origin).resolve() not in _OURS for spec in _FOUND):
    from netlib.files import own_modules  # a script has such modules of its own

    own_modules.guard("handpose")

# Each name is imported when it is first used: one who reads the parameters of a camera
# loads NumPy only.
_MODULES = {
    "frames.cameras": ("CAMERAS", "ICVL", "KINECT2", "MSRA15", "NYU", "SR305", "Camera"),
    "frames.recording": ("CameraInfo", "DepthFrame", "Recording"),
    "frames.formats": ("open_recording",),
    "frames.lens": ("Lens",),
    "frames.live": ("DeviceFrame", "open_device"),
    "frames.writing": ("RecordingWriter",),
    "estimate.packaged": ("load_predictor",),
    "tracking.tracker": ("Tracker", "load_tracker"),
    "output.tracks.json_file": ("Track", "read_track"),
}
_MODULE_OF = {name: f"handpose.{module}" for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import and return a public name. Raises AttributeError for others."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'handpose' has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(_MODULE_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_MODULE_OF])
