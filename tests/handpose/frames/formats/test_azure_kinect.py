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


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (b"no JSON", "is not JSON"),
        (b'{"CalibrationInformation": {"Cameras": []}}', "not the calibration of a depth camera"),
        (azure_file.calibration(azure_file.NUMBERS[:9]), "not the calibration of a depth camera"),
        (azure_file.calibration([0.5, 0.5, -1, *azure_file.NUMBERS[3:]]), "finite and positive"),
        (azure_file.calibration(SensorWidth=640), r"expected one of \(1024, 1024\)"),
        (azure_file.calibration([*azure_file.NUMBERS[:10], 0.1, 0, 0, 0]), r"about \(0.1, 0\)"),
    ],
)
def test_calibrations_that_are_none(tmp_path: Path, said: Any, expected: str) -> None:
    """An invalid calibration raises an error with the file's name."""
    with pytest.raises(DataError, match=rf"a\.mkv: .*{expected}"):
        open_video(put(tmp_path, said), CameraInfo())


@pytest.mark.parametrize("model", ["Theta", "Polynomial3K", "Rational6KT"])
def test_lenses_that_are_not_modelled(tmp_path: Path, model: str) -> None:
    """Lens models that no known device uses raise an error."""
    intrinsics = {"ModelParameters": azure_file.NUMBERS, "ModelType": f"CALIBRATION_LensDistortionModel{model}"}
    with pytest.raises(DataError, match=model):
        open_video(put(tmp_path, azure_file.calibration(Intrinsics=intrinsics)), CameraInfo())


def test_what_has_no_depth(tmp_path: Path) -> None:
    """A recording without depth, or with an unknown mode, raises an error."""
    with pytest.raises(DataError, match="no track DEPTH, only IR, COLOR"):
        open_video(put(tmp_path, track="COLOR"), CameraInfo())
    with pytest.raises(DataError, match="depth mode 'PASSIVE_IR'; expected NFOV_UNBINNED"):
        open_video(put(tmp_path, mode="PASSIVE_IR"), CameraInfo())


def test_a_cut_file(tmp_path: Path) -> None:
    """A truncated file yields its complete frames."""
    path = put(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - 100_000])
    recording = open_video(path, CameraInfo())
    assert len(list(recording)) == 2
    assert recording.cut != ""
