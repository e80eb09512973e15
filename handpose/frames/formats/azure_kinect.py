"""An Azure Kinect's recordings: Matroska with a track DEPTH of raw 16 bits in mm, and the device's calibration.

The calibration is that of the whole sensor of 1024 x 1024, in widths and heights from its upper left corner. A depth
mode bins and crops it, as in the SDK's src/transformation/mode_specific_calibration.c; k4arecord's track, tags and
attachment are those of its src/record/sdk/record.cpp. Neither was tested with a file of a real device.
"""

from __future__ import annotations

import json
import math
from typing import Any

from handpose.frames.cameras import Camera
from handpose.frames.lens import Lens, lens_of
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError

TITLE, TRACK, MODE, CALIBRATION = "Azure Kinect", "DEPTH", "K4A_DEPTH_MODE", "calibration.json"
MODES = {  # width and height of the whole sensor in a mode's pixels, the crop's corner, the frames' width and height
    "NFOV_UNBINNED": ((1024, 1024), (192, 180), (640, 576)),
    "NFOV_2X2BINNED": ((512, 512), (96, 90), (320, 288)),
    "WFOV_UNBINNED": ((1024, 1024), (0, 0), (1024, 1024)),
    "WFOV_2X2BINNED": ((512, 512), (0, 0), (512, 512)),
}
LOCATION, MAX_CALIBRATION_BYTES = "CALIBRATION_CameraLocationD0", 1 << 20  # those of devices have 10,000
MODEL = "CALIBRATION_LensDistortionModel"


def is_recording(container: Any) -> bool:
    """True if this container is an Azure Kinect's."""
    tags = {**container.metadata, **{key: "" for stream in container.streams for key in stream.metadata}}
    return any(key.startswith("K4A_") for key in tags) or tags.get("title") == TITLE


def depth_track(container: Any, where: str) -> Any:
    """Its stream of depth. Raises DataError."""
    tracks = {stream.metadata.get("title", ""): stream for stream in container.streams.video}
    if TRACK not in tracks:
        raise DataError(f"{where}: no track {TRACK}, only {', '.join(filter(None, tracks)) or 'none'}; "
                        "expected an Azure Kinect that recorded depth")
    return tracks[TRACK]


def given(container: Any, stream: Any, where: str) -> CameraInfo:
    """Camera, lens, unit and rate of the depth. Raises DataError."""
    mode = stream.metadata.get(MODE, container.metadata.get(MODE, ""))
    if mode not in MODES:
        raise DataError(f"{where}: depth mode {mode!r}; expected {', '.join(MODES)}")
    rate = float(stream.average_rate) if stream.average_rate else None
    said = next((s for s in container.streams.attachments if s.name == CALIBRATION), None)
    if said is None:  # recordings of other programs may lack it
        return CameraInfo(unit_mm=1.0, rate=rate, origin=where)
    camera, lens = _calibrated(_loaded(said, where), mode, f"{where}: {CALIBRATION}")
    return CameraInfo(camera, lens, 1.0, rate, where)


def _loaded(attachment: Any, where: str) -> Any:
    content = bytes(getattr(attachment, "data", b""))
    if not content:
        raise DataError(f"{where}: this PyAV cannot read {CALIBRATION}, or it is empty: pip install --upgrade av")
    if len(content) > MAX_CALIBRATION_BYTES:
        raise DataError(f"{where}: {CALIBRATION} of {len(content)} bytes; expected at most {MAX_CALIBRATION_BYTES}")
    try:
        return json.loads(content.rstrip(b"\0"))
    except (ValueError, RecursionError) as error:
        raise DataError(f"{where}: {CALIBRATION} is not JSON: {error}") from error


def _calibrated(calibration: Any, mode: str, where: str) -> tuple[Camera, Lens]:
    """The calibration in the JSON of a device. Raises DataError."""
    try:
        cameras = calibration["CalibrationInformation"]["Cameras"]
        depth = next(camera for camera in cameras if camera["Location"] == LOCATION)
        model, numbers = depth["Intrinsics"]["ModelType"], depth["Intrinsics"]["ModelParameters"]
        size = (depth["SensorWidth"], depth["SensorHeight"])
        cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, codx, cody, p2, p1 = (float(number) for number in numbers[:14])
    except (LookupError, TypeError, ValueError, StopIteration, OverflowError) as error:
        raise DataError(f"{where}: not the calibration of a depth camera: {type(error).__name__} {error}") from error
    numbers = (cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, p1, p2)
    if size != (1024, 1024) or codx or cody or not (all(map(math.isfinite, numbers)) and min(fx, fy) > 0):
        raise DataError(f"{where}: a sensor of {size}, intrinsics {numbers[:4]}, distortion about ({codx:g}, {cody:g})"
                        "; expected one of (1024, 1024), finite and positive, about (0, 0)")
    if not isinstance(model, str) or not model.startswith(MODEL):
        raise DataError(f"{where}: the lens is a {model!r}; expected {MODEL}BrownConrady")
    (sensor_width, sensor_height), (left, top), (width, height) = MODES[mode]
    camera = Camera(
        f"azure kinect {mode}", fx * sensor_width, fy * sensor_height,
        cx * sensor_width - left - 0.5, cy * sensor_height - top - 0.5,  # a pixel's centre is at a whole number
        width, height,
    )
    kind = model.removeprefix(MODEL)
    if kind != "BrownConrady" and (p1 or p2):  # Rational6KT halves the mixed terms of p1 and p2
        raise DataError(f"{where}: the lens is a {kind} with tangential distortion; expected BrownConrady")
    named = {"BrownConrady": "brown_conrady", "Rational6KT": "rational_6kt"}.get(kind, kind)
    return camera, lens_of(named, (k1, k2, p1, p2, k3, k4, k5, k6), where)
