"""Recordings of Azure Kinect, written here with the structure of k4arecord."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats.video import open_video
from handpose.frames.lens import Lens
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from tests.support import azure_file
from tests.support.bad_input import bad_inputs

pytest.importorskip("av", reason="PyAV is missing: pip install av")

# Sizes, and the pixel at the sensor's middle, which is half a pixel before the middle of an uncropped grid.
MODES = [
    ("NFOV_UNBINNED", (576, 640), (512 - 192 - 0.5, 512 - 180 - 0.5), 512),
    ("NFOV_2X2BINNED", (288, 320), (256 - 96 - 0.5, 256 - 90 - 0.5), 256),
    ("WFOV_UNBINNED", (1024, 1024), (511.5, 511.5), 512),
    ("WFOV_2X2BINNED", (512, 512), (255.5, 255.5), 256),
]
MIDDLE = [0.5, 0.5, 0.5, 0.5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]  # cx cy fx fy and no distortion


def depth(shape: tuple[int, int] = (288, 320), count: int = 3) -> np.ndarray[Any, Any]:
    return np.random.default_rng(0).integers(0, 6000, (count, *shape)).astype(np.uint16)


def put(folder: Path, said: Any = None, **more: Any) -> Path:
    return azure_file.write(folder / "a.mkv", depth(), said=said or azure_file.calibration(), **more)


@pytest.mark.parametrize(("mode", "shape", "middle", "focal"), MODES)
def test_depth_and_camera(
    tmp_path: Path, mode: str, shape: tuple[int, int], middle: tuple[float, float], focal: float
) -> None:
    """Depth in mm comes from the track DEPTH, and the calibration is converted to the pixels of the mode."""
    images = depth(shape, 2)
    path = azure_file.write(tmp_path / "a.mkv", images, mode, azure_file.calibration(MIDDLE))
    recording = open_video(path, CameraInfo())
    camera = recording.camera
    assert (camera.u0, camera.v0, camera.fx, camera.fy) == (*middle, focal, focal)
    assert (camera.height, camera.width, recording.unit_mm, recording.rate) == (*shape, 1.0, 30.0)
    read = list(recording)
    assert [f.time for f in read] == pytest.approx([0, 1 / 30], abs=0.0006)
    assert all(np.array_equal(f.depth, image) for f, image in zip(read, images))
    assert recording.cut == ""


def test_the_lens(tmp_path: Path) -> None:
    """The lens is that of the calibration, with p1 and p2 in OpenCV's order."""
    path = put(tmp_path)
    own = open_video(path, CameraInfo())
    k = azure_file.NUMBERS
    lens = Lens((k[4], k[5], k[13], k[12], *k[6:10]))
    same = open_video(path, CameraInfo(own.camera, lens))
    none = open_video(path, CameraInfo(own.camera, Lens()))
    first = next(iter(own)).depth
    assert np.array_equal(first, next(iter(same)).depth)
    assert not np.array_equal(first, next(iter(none)).depth)


def test_without_a_calibration(tmp_path: Path) -> None:
    """Without a calibration the camera must be given, and the unit is known."""
    path = azure_file.write(tmp_path / "a.mkv", depth())
    with pytest.raises(DataError, match="the camera of these frames is unknown"):
        open_video(path, CameraInfo())
    camera = Camera("own", 250, 250, 160, 144, 0, 0)
    assert open_video(path, CameraInfo(camera=camera, origin="--camera")).unit_mm == 1.0


def lens(model: str) -> dict[str, Any]:
    """The changes of a calibration with a lens of this model."""
    kind = f"CALIBRATION_LensDistortionModel{model}"
    return {"said": azure_file.calibration(Intrinsics={"ModelParameters": azure_file.NUMBERS, "ModelType": kind})}


@bad_inputs(DataError, {
    "no JSON": ({"said": b"no JSON"}, "...a.mkv: calibration.json is not JSON: ..."),
    "no camera": ({"said": b'{"CalibrationInformation": {"Cameras": []}}'},
                  "...a.mkv: calibration.json: not the calibration of a depth camera: StopIteration..."),
    "too few numbers": ({"said": azure_file.calibration(azure_file.NUMBERS[:9])},
                        "...a.mkv: calibration.json: not the calibration of a depth camera: ValueError ..."),
    "a negative focal length": ({"said": azure_file.calibration([0.5, 0.5, -1, *azure_file.NUMBERS[3:]])},
                                "...a.mkv: calibration.json: a sensor of (1024, 1024), intrinsics (0.5, 0.5, -1.0, "
                                "0.4922), ...; expected one of (1024, 1024), finite and positive, about (0, 0)"),
    "another sensor": ({"said": azure_file.calibration(SensorWidth=640)},
                       "...a.mkv: calibration.json: a sensor of (640, 1024), ...; expected one of (1024, 1024), ..."),
    "another centre": ({"said": azure_file.calibration([*azure_file.NUMBERS[:10], 0.1, 0, 0, 0])},
                       "...a.mkv: calibration.json: ..., distortion about (0.1, 0); expected ..., about (0, 0)"),
    "Theta": (lens("Theta"), "...a.mkv: calibration.json: the lens is a Theta with ...; expected BrownConrady"),
    "Polynomial3K": (lens("Polynomial3K"),
                     "...a.mkv: calibration.json: the lens is a Polynomial3K with ...; expected BrownConrady"),
    "Rational6KT": (lens("Rational6KT"),
                    "...a.mkv: calibration.json: the lens is a Rational6KT with ...; expected BrownConrady"),
    "no depth": ({"track": "COLOR"}, "...a.mkv: no track DEPTH, only IR, COLOR; expected an Azure Kinect that ..."),
    "an unknown mode": ({"mode": "PASSIVE_IR"}, "...a.mkv: depth mode 'PASSIVE_IR'; expected NFOV_UNBINNED, ..."),
})
def test_recordings_that_are_refused(tmp_path: Path, given: dict[str, Any], rejected: Any) -> None:
    """An invalid calibration, a lens that no known device has, and a recording without depth raise an error."""
    with rejected:
        open_video(put(tmp_path, **given), CameraInfo())


def test_a_cut_file(tmp_path: Path) -> None:
    """A truncated file yields its complete frames."""
    path = put(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - 100_000])
    recording = open_video(path, CameraInfo())
    assert len(list(recording)) == 2
    assert recording.cut != ""
