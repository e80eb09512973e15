"""Matroska files as k4arecord writes them: tracks, tags and the attachment, with made-up depth."""

from __future__ import annotations

import json
import struct
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

# cx cy fx fy k1 ... k6 codx cody p2 p1, as in a device's calibration and of realistic size
NUMBERS = [0.51, 0.495, 0.4921, 0.4922, 3.13, 2.32, 0.13, 3.46, 3.35, 0.66, 0, 0, -5e-5, 8e-5]


def calibration(numbers: list[float] = NUMBERS, **changes: Any) -> dict[str, Any]:
    """Return the contents of calibration.json for the depth camera and the colour camera."""
    depth = {
        "Intrinsics": {
            "ModelParameterCount": 14,
            "ModelParameters": numbers,
            "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
        },
        "Location": "CALIBRATION_CameraLocationD0",
        "MetricRadius": 1.74,
        "SensorHeight": 1024,
        "SensorWidth": 1024,
    }
    colour = {**depth, "Location": "CALIBRATION_CameraLocationPV0", "SensorHeight": 3072, "SensorWidth": 4096}
    return {"CalibrationInformation": {"Cameras": [colour, depth | changes]}}


def write(
    path: Path,
    depth: np.ndarray[Any, Any],
    mode: str = "NFOV_2X2BINNED",
    said: dict[str, Any] | bytes | None = None,
    track: str = "DEPTH",
    rate: int = 30,
) -> Path:
    """Write frames (n, height, width) of whole millimetres after a track of infrared; ``said`` is the calibration."""
    import av

    with av.open(str(path), "w", format="matroska", options={"allow_raw_vfw": "1"}) as container:
        container.metadata["title"] = "Azure Kinect"
        streams = []
        for title in ("IR", track):
            stream = container.add_stream("rawvideo", rate=rate)
            stream.height, stream.width = depth.shape[1:]
            stream.pix_fmt = "gray16be"
            stream.metadata["title"] = title
            stream.metadata[f"K4A_{title}_MODE"] = mode if title == track else "ACTIVE"
            streams.append(stream)
        if said is not None:
            content = said if isinstance(said, bytes) else json.dumps(said).encode()
            container.add_attachment("calibration.json", "application/octet-stream", content)
        for i, image in enumerate(depth):
            for stream, values in zip(streams, (np.full_like(image, 77), image)):
                picture = av.VideoFrame.from_ndarray(values, format="gray16be")
                picture.pts, picture.time_base = i, Fraction(1, rate)
                container.mux(stream.encode(picture))
    width, height = depth.shape[2], depth.shape[1]  # for a bitmap's header FFmpeg has no codec for such pixels
    theirs, ours = (struct.pack("<IiiHH", 40, width, h, 1, 16) for h in (-height, height))
    path.write_bytes(path.read_bytes().replace(theirs + b"\0\0\0\0", ours + b"b16g"))
    return path
