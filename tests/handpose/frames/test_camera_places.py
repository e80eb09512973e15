"""handpose/frames/camera_places.py: files with a camera near the frames, where
programs write them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.frames.camera_file import to_text, write
from handpose.frames.camera_places import next_to, places_next_to
from handpose.frames.cameras import Camera
from handpose.frames.formats import open_recording
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, hand_sized, middles, put
from tests.support.bad_input import bad_inputs

OPEN3D = '{"width": 64, "height": 48, "intrinsic_matrix": [60, 0, 0, 0, 61, 0, 31.5, 23.5, 1]}'
TABLE = "60 0 31.5 0\n0 61 23.5 0\n0 0 1 0\n0 0 0 1\n"
OTHER = OPEN3D.replace("60", "70")
VIEWER = """Stream,Depth
Resolution x,64
Resolution y,48
,
Intrinsic:,
Fx,60
Fy,61
PPx,31.5
PPy,23.5
"""
XML = '<?xml version="1.0"?>\n<opencv_storage></opencv_storage>\n'


@pytest.fixture(autouse=True)
def depth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder take/depth with frames; the working directory is that of take."""
    monkeypatch.chdir(tmp_path)
    for number in range(3):
        put(Path(f"take/depth/{number:06}.png"), hand_sized(distance=1000 + number))
    return Path("take/depth")


def wrote(name: str, text: str | bytes = OPEN3D) -> Path:
    path = Path("take", name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_the_camera_json_of_a_recording() -> None:
    """A folder has its own camera.json; for a file, the file's own name takes precedence."""
    take = Path("take/take.npz")
    assert next_to(Path("take/depth")) == next_to(take) == UNKNOWN
    write(Path("take/camera.json"), CameraInfo(unit_mm=1.0))
    write(Path("take/take.camera.json"), CameraInfo(unit_mm=2.0))
    assert next_to(take).unit_mm == 2
    assert next_to(Path("take")).unit_mm == 1


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera_intrinsic.json", OPEN3D),  # Open3D's recorder
        ("intrinsic/intrinsic_depth.txt", TABLE),  # ScanNet
        ("cam_K.txt", "60 0 31.5\n0 61 23.5\n0 0 1\n"),
        ("K.txt", "60 61 31.5 23.5"),
        ("camera.txt", "60 61 31.5 23.5"),
        (
            "scene_camera.json",
            json.dumps({"0": {"cam_K": [60, 0, 31.5, 0, 61, 23.5, 0, 0, 1]}}),
        ),  # BOP
        ("sensor.yaml", "intrinsics: [60, 61, 31.5, 23.5]\nresolution: [64, 48]\n"),  # EuRoC
        (
            "calibration/840412060917_64x48.yml",
            "depth:\n  fx: 60\n  fy: 61\n  ppx: 31.5\n  ppy: 23.5\n",
        ),  # DexYCB
        (
            "rs-enumerate-devices.txt",
            'Intrinsic of "Depth" / 64x48 / {Z16}\n Fx: 60\n Fy: 61\n PPX: 31.5\n PPY: 23.5\n',
        ),
        ("depth/ost.txt", "camera matrix\n60 0 31.5\n0 61 23.5\n0 0 1\n"),
        ("depth/calib/depth.ini", "fx=60\nfy=61\ncx=31.5\ncy=23.5\n"),
        ("realsense/camera_intrinsic.json", OPEN3D),
        ("any/camera_intrinsic.json", OPEN3D),
        ("meta/camera_info.yaml", "K: [60, 0, 31.5, 0, 61, 23.5, 0, 0, 1]\n"),
        ("depth/camera.yaml", OPEN3D),
        ("depth/calibration.json", OPEN3D),
        ("info.txt", "m_calibrationDepthIntrinsic = " + " ".join(TABLE.split())),
        ("depth/take_Depth_metadata.csv", VIEWER),
    ],
)
def test_camera_files_of_other_programs_are_found(depth: Path, name: str, text: str) -> None:
    """In the folder of the frames, its parent, or a folder next to it."""
    path = wrote(name, text)
    for source in (depth, depth / "*.png", depth.absolute()):
        recording = open_recording(source)
        assert recording.camera == CAMERA
        assert any(str(path) in remark for remark in recording.remarks)
    assert path in places_next_to(depth)
    assert next_to(depth, is_needed=False) == UNKNOWN


def test_the_folder_in_the_error_is_that_of_the_frames() -> None:
    """As for the folder of Open3D's recorder, whose camera is then found."""
    wrote("camera_intrinsic.json")
    put(Path("take/color/000000.jpg"), np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(
        DataError, match=r"found camera_intrinsic\.json, color, depth; name the"
    ) as raised:
        open_recording("take")
    folder = str(raised.value).partition("name the folder of the frames, as '")[2].removesuffix("'")
    assert open_recording(folder).camera == CAMERA


def test_the_camera_is_found_from_within_the_folder(
    depth: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrote("camera_intrinsic.json")
    monkeypatch.chdir(depth)
    assert open_recording(".").camera == CAMERA


def test_the_camera_of_an_array(depth: Path) -> None:
    np.save("take/take.npy", hand_sized()[None])
    wrote("camera_intrinsics.json")
    assert open_recording("take/take.npy").camera == CAMERA


def test_the_nearest_and_the_depth_come_first(depth: Path) -> None:
    """Files of colours are not used, and what camera.json says besides the camera is kept."""
    wrote("color/intrinsics.json", OTHER)
    wrote("intrinsics_color.json", OTHER)
    wrote("intrinsics_ir.json", OTHER)
    wrote("intrinsics_depth.json")
    wrote("calibration/depth.txt", "70 71 31.5 23.5")
    write(depth / "camera.json", CameraInfo(unit_mm=0.25))
    recording = open_recording(depth)
    assert (recording.camera, recording.unit_mm) == (CAMERA, 0.25)
    wrote("depth/intrinsics.json", OTHER)
    assert open_recording(depth).camera.fx == 70


def test_the_mode_of_the_frames_size(depth: Path) -> None:
    blocks = (
        f'Intrinsic of "Depth" / {w}x{h} / {{Z16}}\n  Width: {w}\n  Height: {h}\n  PPX: {(w - 1) / 2}\n  PPY: '
        f"{(h - 1) / 2}\n  Fx: {w - 4}\n  Fy: {h + 13}\n"
        for w, h in ((128, 96), (64, 48))
    )
    wrote("rs-enumerate-devices.txt", "\n".join(blocks))
    recording = open_recording(depth)
    assert recording.camera == CAMERA
    assert not any("field of view" in remark for remark in recording.remarks)
    for number in range(3):
        hand_sized(distance=1000 + number).tofile(wrote(f"raw/{number}.raw"))
    assert middles(open_recording("take/raw")) == [1000, 1001, 1002]


@pytest.mark.parametrize(
    "name",
    [
        "other/camera.json",
        "others/camera.json",
        "wave.camera.json",
        "wave.truth.json",
        "camera_pose.txt",
        "notes.txt",
    ],
)
def test_files_of_other_recordings_are_not_used(depth: Path, name: str) -> None:
    """A camera.json among frames is theirs; so is NAME.camera.json; and not every
    text is looked at.
    """
    put(Path("take/other/0.png"), hand_sized())
    wrote(name, to_text(CameraInfo(Camera("other", 70.0, 71.0, 31.5, 23.5, 64, 48))))
    with pytest.raises(
        DataError, match="the camera of these frames is unknown; give --camera FILE"
    ):
        open_recording(depth)


@bad_inputs(
    DataError,
    {
        "XML": (
            {"camera_intrinsic.xml": XML},
            "...(not used: take/camera_intrinsic.xml: XML; expected JSON or YAML, ...); give ...",
        ),
        "cut": (
            {"camera_intrinsic.json": OPEN3D[:-5]},
            "...(not used: take/camera_intrinsic.json: not whole JSON: ...); give ...",
        ),
        "a pickle": (
            {"depth/intrinsics.pkl": b"\x80\x04\x95"},
            "...(not used: take/depth/intrinsics.pkl: cannot read the ...); give ...",
        ),
        "an array": (
            {"K.npy": b"\x93NUMPY"},
            "...(not used: take/K.npy: cannot read the camera: not a text file); give ...",
        ),
        "a preset": (
            {"realsense.json": '{"parameters": {"controls-laserpower": "150"}}'},
            "...(not used: take/realsense.json: unknown key 'parameters'); give ...",
        ),
        "colours": (
            {"intrinsic/intrinsic_color.txt": TABLE},
            "...(not used: take/intrinsic/intrinsic_color.txt: the camera of colours); give --camera FILE ...",
        ),
        "colours in it": (
            {"intrinsics.json": f'{{"rgb": {OPEN3D}}}'},
            "...(not used: take/intrinsics.json: the camera of colours); give --camera FILE ...",
        ),
        "no camera": (
            {"meta/info.json": '{"fps": 30}'},
            "...(not used: take/meta/info.json: no camera); give --camera ...",
        ),
        "two": (
            {"calibration.json": OPEN3D, "intrinsics.json": OTHER},
            "...(not used: take/calibration.json (...) and take/intrinsics.json (...) are different cameras); give ...",
        ),
        "another size": (
            {"intrinsics.json": OPEN3D.replace("64", "640")},
            "...000000.png: 64 x 48 pixels; camera own has 640 x 48, by take/intrinsics.json (...)",
        ),
        "its own": (
            {"depth/camera.json": '{"fx": 60}'},
            "take/depth/camera.json: has fx, but not fy and u0 and v0",
        ),
    },
)
def test_unreadable_camera_files_are_named(
    depth: Path, given: dict[str, Any], rejected: Any
) -> None:
    """With the reason, but only if they are needed."""
    for name, text in given.items():
        wrote(name, text)
    with rejected:
        open_recording(depth)
    if "depth/camera.json" not in given:
        assert open_recording(depth, CameraInfo(CAMERA, origin="--camera")).camera == CAMERA
