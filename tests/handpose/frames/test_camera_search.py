"""handpose/frames/camera_search.py, camera_object.py: cameras in the files of other programs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.camera_file import parse
from handpose.frames.camera_search import find
from handpose.frames.camera_text import parse_document
from handpose.frames.cameras import Camera, View
from handpose.frames.lens import Lens
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs

MATRIX = np.array([[60, 0, 31.5], [0, 61, 23.5], [0, 0, 1.0]])
ROWS = json.dumps(MATRIX.tolist())
CAMERA, SIZED = (Camera("own", 60, 61, 31.5, 23.5, *size) for size in ((0, 0), (64, 48)))
BY_COLUMNS = json.dumps(MATRIX.T.ravel().tolist())
OPEN3D = f'{{"width": 64, "height": 48, "intrinsic_matrix": {BY_COLUMNS}}}'
ROS = """# written by a driver
image_width: 64
image_height: 48
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [60.0, 0.0, 31.5,
         0., 61.0, 23.5,   # the second row
         0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0.01, 0.02, 0.3]}
projection_matrix:
  rows: 3
  cols: 4
  data: [70, 0, 32, 0, 0, 70, 24, 0, 0, 0, 1, 0]
"""
TOPIC = """header:
  seq: 17
  stamp: {secs: 1, nsecs: 2}
  frame_id: ''
height: 48
width: 64
distortion_model: "plumb_bob"
D:
  - 0.0
  - 0.0
K: [60.0, 0.0, 31.5, 0.0, 61.0, 23.5, 0.0, 0.0, 1.0]
binning_x: 0
roi:
  x_offset: 0
  do_rectify: false
---
height: 1
"""
KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [60, 61, 31.5, 23.5]
  distortion_model: radtan
  distortion_coeffs: [0.1, -0.2, 0.01, 0.02]
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.0]
  - [0.0, 1.0, 0.0, 0.0]
  resolution: [64, 48]
  rostopic: /cam0/depth
"""
ORB_SLAM = """%YAML:1.0
Camera.fx: 60.0
Camera.fy: 61.0
Camera.cx: 31.5
Camera.cy: 23.5
Camera.k1: 0.1
Camera.k2: -0.2
Camera.p1: 0.0
Camera.p2: 0.0
Camera.k3: 0.3
Camera.width: 64
Camera.height: 48
Viewer.ViewpointX: 0
"""
LISTED = """ Intrinsic of "Color" / 64x48 / {RGB8}
  Width:      \t64
  Height:     \t48
  PPX:        \t1
  PPY:        \t2
  Fx:         \t3
  Fy:         \t4
 Intrinsic of "Depth" / 64x48 / {Z16}
  Width:      \t64
  Height:     \t48
  PPX:        \t31.5
  PPY:        \t23.5
  Fx:         \t60
  Fy:         \t61
  Distortion: \tBrown Conrady
  Coeffs:     \t0.1  \t0  \t0  \t0  \t0
  FOV (deg):  \t50 x 40
"""
TWO_STREAMS = {
    "color": {"intrinsics": {"fx": 1, "fy": 2, "ppx": 3, "ppy": 4}},
    "depth_scale": 0.001,
    "fps": 30,
    "depth": {
        "intrinsics": {
            "fx": 60,
            "fy": 61,
            "ppx": 31.5,
            "ppy": 23.5,
            "width": 64,
            "height": 48,
            "coeffs": [0, 0, 0, 0, 0],
            "model": "Brown Conrady",
        }
    },
}
TRAJECTORY = {
    "class_name": "PinholeCameraTrajectory",
    "parameters": [{"extrinsic": [1.0] * 16, "intrinsic": json.loads(OPEN3D)} for _ in range(2)],
}


@pytest.mark.parametrize(
    ("text", "camera", "words"),
    [
        (OPEN3D, SIZED, "width, height, intrinsic_matrix"),
        (json.dumps(TRAJECTORY), SIZED, "width, height, intrinsic_matrix"),
        (ROWS, CAMERA, "matrix"),
        ("60 0 31.5\n0 61 23.5\n0 0 1\n", CAMERA, "matrix"),
        ("[[60.   0.  31.5]\n [ 0.  61.  23.5]\n [ 0.   0.   1. ]]", CAMERA, "matrix"),
        ("6.0e+01,0,0\n0,61,0\n31.5,23.5,1", CAMERA, "matrix"),
        ("60 0 31.5 0\n0 61 23.5 0\n0 0 1 0\n0 0 0 1", CAMERA, "matrix"),
        ("# K of the depth camera 1\n60 0 31.5\n0 61 23.5\n0 0 1\n", CAMERA, "matrix"),
        ("60 61 31.5 23.5", CAMERA, "matrix"),
        ("60 61 31.5 23.5 64 48", SIZED, "matrix, size"),
        ("64 48 60 61 31.5 23.5", SIZED, "matrix, size"),  # ARKitScenes
        (
            f'{{"0": {{"cam_K": {BY_COLUMNS}, "cam_t": [1]}}, "1": {{"cam_K": {BY_COLUMNS}, "cam_t": [2]}}}}',
            CAMERA,
            "cam_K; not used: cam_t",
        ),
        (
            f'{{"cameraData": [[2, {{"intrinsicMatrix": {ROWS}, "width": 64, "height": 48}}]]}}',
            SIZED,
            "intrinsicMatrix, width, height",
        ),
        (
            "fx_depth = 60\nfy_depth = 61\nmx_depth = 31.5\nmy_depth = 23.5\ndepthWidth = 64\ndepthHeight = 48\n",
            SIZED,
            "fx_depth, fy_depth, mx_depth, my_depth, depthWidth, depthHeight",
        ),
        (
            f'{{"camera_matrix": {ROWS}, "image_size": [64, 48], "avg_reprojection_error": 0.1}}',
            SIZED,
            "camera_matrix, image_size; not used: avg_reprojection_error",
        ),
        (
            '{"fl_x": 60, "fl_y": 61, "cx": 31.5, "cy": 23.5, "w": 64, "h": 48, "frames": []}',
            SIZED,
            "fl_x, fl_y, cx, cy, w, h; not used: frames",
        ),
        (
            '{"fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5, "scale": 0.5, "fl_unit": "px"}',
            CAMERA,
            "fx, fy, cx, cy; not used: scale, fl_unit",
        ),
        (
            '{"intrinsics": {"focalLength": {"x": 60, "y": 61}, "principalPoint": {"x": 31.5, "y": 23.5}, '
            '"resolution": {"x": 64, "y": 48}}}',  # AR Foundation
            SIZED,
            "focalLength, principalPoint, resolution",
        ),
        ('{"focal": [60, 61], "princpt": [31.5, 23.5]}', CAMERA, "focal, princpt"),  # InterHand
        (f'{{"K": {BY_COLUMNS}, "fx": null, "resolution": "64x48"}}', SIZED, "K, resolution"),
        (f'{{"K": {BY_COLUMNS}, "resolution": "64 by 48"}}', CAMERA, "K; not used: resolution"),
        (
            f'{{"K": {BY_COLUMNS}, "w": 64, "h": 48, "poses": [[0, 0, 0]]}}',
            SIZED,
            "K, w, h; not used: poses",
        ),
    ],
)
def test_the_only_camera_of_a_file_is_read(text: str, camera: Camera, words: str) -> None:
    """Open3D's camera and trajectory, tables, ScanNet's, OpenCV's, NeRF's and Record3D's."""
    found = parse(text, "x")
    assert (found.camera, found.lens, found.origin) == (camera, None, f"x ({words})")


@pytest.mark.parametrize(
    ("text", "name", "lens"),
    [
        (ROS, "narrow_stereo", (0.1, -0.2, 0.01, 0.02, 0.3)),
        (TOPIC, "own", ()),
        (KALIBR, "own", (0.1, -0.2, 0.01, 0.02)),
        (ORB_SLAM, "own", (0.1, -0.2, 0, 0, 0.3, 0, 0, 0)),
        (LISTED, "own", (0.1, 0, 0, 0, 0)),
        (
            json.dumps(
                {
                    "k": MATRIX.ravel().tolist(),
                    "d": [0.1, 0, 0, 0, 0],
                    "width": 64,
                    "height": 48,
                    "r": [],
                    "p": [],
                    "distortion_model": "plumb_bob",
                    "header": {"frame_id": ""},
                }
            ),
            "own",
            (0.1, 0, 0, 0, 0),
        ),
        (
            json.dumps(
                {
                    "intrinsics": {"fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5},
                    "distortion": {"k1": 0.1, "p2": 0.2},
                    "resolution": {"width": 64, "height": 48},
                }
            ),
            "own",
            (0.1, 0, 0, 0.2, 0, 0, 0, 0),
        ),
    ],
)
def test_a_camera_is_read_with_its_lens(text: str, name: str, lens: tuple[float, ...]) -> None:
    """ROS's calibration, a topic's messages, Kalibr, ORB-SLAM, RealSense's list, ROS 2 in JSON,
    objects in objects.
    """
    found = parse(text, "x")
    assert found.camera == Camera(name, 60, 61, 31.5, 23.5, 64, 48)
    assert found.lens == Lens(lens)


def test_names_tell_the_depth_camera_from_others() -> None:
    """What is said around it holds for it, too."""
    found = parse(json.dumps(TWO_STREAMS), "x")
    assert (found.camera, found.lens, found.unit_mm, found.rate) == (SIZED, Lens(), 1.0, 30)


def test_texts_tell_the_depth_camera_in_a_list() -> None:
    """If the names around it say nothing."""
    cameras = [
        {"name": kind, "K": [60 + i, 0, 31.5, 0, 61, 23.5, 0, 0, 1], "width": 64, "height": 48}
        for i, kind in ((2, "rgb"), (0, "depth"), (1, "left infrared"))
    ]
    found = parse(json.dumps({"cameras": cameras}), "x")
    assert found.camera == replace(SIZED, name="depth")


@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [
        ("depth_scale", 0.00025, 0.25),
        ("depth_scale", 1000.0, 1.0),
        ("png_depth_scale", 5000, 0.2),
        ("depth_scale", 0.1, 0.1),
        ("DepthMapFactor", 5000.0, 0.2),
        ("factor", 5000, 0.2),
        ("depth_units", 0.000125, 0.125),
        ("depth_unit", "mm", 1.0),
        ("depth_units", "Meters", 1000.0),
        ("depth_to_meters", 0.0001, 0.1),
        ("depth_scaling_factor", 5000, 0.2),
    ],
)
def test_a_depth_scale_of_any_kind_gives_the_unit(name: str, value: Any, unit: float) -> None:
    """In metres, in mm, or the number of values per metre."""
    assert find({"K": MATRIX.tolist(), name: value}, "x").info.unit_mm == pytest.approx(unit)


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".json"])
def test_files_that_opencv_writes_are_read(tmp_path: Path, suffix: str) -> None:
    """Those of cv2.FileStorage."""
    storage = cv2.FileStorage(str(tmp_path / f"camera{suffix}"), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Sat 28 Nov 2026")
    storage.write("image_width", 64)
    storage.write("image_height", 48)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", np.array([[0.1], [-0.2], [1e-3], [0], [0.3]]))
    storage.release()
    found = camera_file.read(tmp_path / f"camera{suffix}")
    assert (found.camera, found.lens) == (SIZED, Lens((0.1, -0.2, 1e-3, 0, 0.3)))
    assert found.origin.endswith("distortion_coefficients; not used: calibration_time)")


@pytest.mark.parametrize(
    "text",
    [
        "a:\n- 1\n- -2.5e+3\ng: # h\nl:\n  m:\n    n: [3.5, .5e-1,\n      4]\n  o: -0.5\n"
        "'p q': [[1, 2],\n  [3, 4]]\ns: t u\n",
        '%YAML 1.1\n---\na:\n  - 1\n  - 2\nb: {c: 2, d: [1, 2], e: "f"}\n...\nb: 1\n',
    ],
)
def test_yaml_is_read_as_by_a_reader_of_yaml(text: str) -> None:
    yaml = pytest.importorskip("yaml")

    def flat(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: flat(inner) for key, inner in value.items()}
        rows = np.array(value, object).ravel().tolist() if isinstance(value, list) else value
        return rows

    assert flat(parse_document(text, "x")) == flat(next(yaml.safe_load_all(text)))


# What other programs print or write: 64 x 48 px, focal lengths 60 and 61, the middle at 31.5, 23.5.


def intrinsic(kind: str, code: str, lens: str, factor: int, shift: float = 0) -> str:
    """The part of ENUMERATED about a stream whose size is ``factor`` times 64 x 48."""
    width, height = 64 * factor, 48 * factor
    return f"""
 Intrinsic of "{kind}" / {width}x{height} / {{{code}}}
  Width:      \t{width}
  Height:     \t{height}
  PPX:        \t{factor * (32 + shift) - 0.5}
  PPY:        \t{factor * (24 + shift) - 0.5}
  Fx:         \t{factor * (60 + shift)}
  Fy:         \t{factor * (61 + shift)}
  Distortion: \t{lens}
  Coeffs:     \t0  \t0  \t0  \t0  \t0
  FOV (deg):  \t89.97 x 58.99
"""


INTRINSICS = "\n".join(
    intrinsic(kind, code, lens, factor, shift)
    for kind, code, shift, lens in (
        ("Depth", "Z16", 0, "Brown Conrady"),
        ("Infrared 1", "Y8", 0, "Brown Conrady"),
        ("Infrared 2", "Y8", 0.25, "Brown Conrady"),
        ("Color", "RGB8", 7, "Inverse Brown Conrady"),
    )
    for factor in (1, 2)
)
ENUMERATED = f"""Device info:
    Name                          : \tIntel RealSense D455
    Firmware Version              : \t05.13.00.50
    Physical Port                 : \t/sys/devices/pci0000:00/0000:00:14.0/usb2/2-1/video4linux/video0

Stream Profiles supported by Stereo Module
 Supported modes:
    Depth    \t  64x48\t@ 30Hz\t   Z16
    Depth    \t  128x96\t@ 30Hz\t   Z16

Intrinsic Parameters:
{INTRINSICS}
Extrinsic from "Depth"\t  To\t  "Color" :
 Rotation Matrix:
   0.99998\t  -0.0031\t   0.0029
   0.0031\t    0.99999\t   0.0006
  -0.0029\t   -0.0006\t   0.99999
 Translation Vector: \t0.0147  \t0.0002  \t0.0003

Extrinsic from "Depth"\t  To\t  "Depth" :
 Rotation Matrix:
   1  \t0  \t0
   0  \t1  \t0
   0  \t0  \t1
"""
OST = """# oST version 5.0 parameters


[image]

width
64

height
48

[narrow_stereo]

camera matrix
60.000000 0.000000 31.500000
0.000000 61.000000 23.500000
0.000000 0.000000 1.000000

distortion
0.100000 -0.200000 0.010000 0.020000 0.000000

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000

projection
70.000000 0.000000 32.000000 0.000000
0.000000 70.000000 24.000000 0.000000
0.000000 0.000000 1.000000 0.000000
"""
SECTIONS = """[ColorIntrinsic]
fx=1
fy=2
cx=3
cy=4
width=64
height=48
[DepthIntrinsic]
fx=60
fy=61
cx=31.5
cy=23.5
width=64
height=48
[ColorDistortion]
k1=9
[DepthDistortion]
k1=0.1
k2=-0.2
p1=0.01
p2=0.02
"""
LENS = Lens((0.1, -0.2, 0.01, 0.02, 0.0))


@pytest.mark.parametrize(
    ("text", "lens"),
    [
        ("[ 64x48  p[31.5 23.5]  f[60 61]  Brown Conrady [0.1 -0.2 0.01 0.02 0] ]", LENS),
        (
            "depth: [ 64x48  p[31.5 23.5]  f[60 61]  Brown Conrady [0.1 -0.2 0.01 0.02 0] ]\n"
            "color: [ 64x48  p[30 20]  f[50 50]  Inverse Brown Conrady [0 0 0 0 0] ]",
            LENS,
        ),
        (
            "width: 64, height: 48, ppx: 31.5, ppy: 23.5, fx: 60, fy: 61, model: Brown Conrady, "
            "coeffs: [0.1, -0.2, 0.01, 0.02, 0]",
            LENS,
        ),
        ("{'fx': 60.0, 'fy': 61.0, 'ppx': 31.5, 'ppy': 23.5, 'width': 64, 'height': 48}", None),
        (
            "{'K': array([[60. ,  0. , 31.5],\n       [ 0. , 61. , 23.5],\n       [ 0. ,  0. "
            ",  1. ]]), 'size': [64, 48]}",
            None,
        ),
        (
            "{'color': {'fx': 1, 'fy': 2, 'cx': 3, 'cy': 4}, 'depth': {'fx': 60, 'fy': 61.0, 'cx': 31.5, 'cy': 23.5, "
            "'width': 64, 'height': 48, 'model': 'Brown Conrady', 'coeffs': [0.1, -0.2, 0.01, 0.02, 0.0]}}",
            LENS,
        ),
        ("<OBCameraIntrinsic fx=60 fy=61.0 cx=31.5 cy=23.5 width=64 height=48>", None),
        (
            "resolution width: 64\nresolution height: 48\nprincipal point x: 31.5\nprincipal point y: 23.5\n"
            "focal length x: 60\nfocal length y: 61\nradial distortion coefficients:\nk1: 0.1\nk2: -0.2\nk3: 0\n"
            "center of distortion in Z=1 plane, x: 0\ntangential distortion coefficient x: 0.01\n"
            "tangential distortion coefficient y: 0.02\nmetric radius: 0\n",
            Lens((0.1, -0.2, 0.01, 0.02, 0, 0, 0, 0)),
        ),
        (
            "Stream,Depth\nFormat,Z16\nResolution x,64\nResolution "
            "y,48\n\nIntrinsic:,\nFx,60\nFy,61\nPPx,31.5\nPPy,23.5\n"
            "Distorsion,Brown Conrady\n",
            Lens(),
        ),
        ("fx 60\nfy 61\ncx 31.5\ncy 23.5\nwidth 64\nheight 48\n", None),
        ("fx 60 px\n# fx 70\nfy: 61 px\ncx: 31.5 # middle\ncy: 23.5\nimage size: 64 x 48\n", None),
        ('{"camMat": [[60, 0, 31.5], [0, 61, 23.5], [0, 0, 1]], "resolution": [64, 48]}', None),
        (
            '{"focal_length": [60, 61], "principal_point": [31.5, 23.5], "image_size": [64, 48]}',
            None,
        ),
        (
            "m_depthWidth = 64\nm_depthHeight = 48\nm_depthShift = 1000\n"
            "m_calibrationColorIntrinsic = 1 0 1 0 0 1 1 0 0 0 1 0 0 0 0 1\n"
            "m_calibrationDepthIntrinsic = 60 0 31.5 0 0 61 23.5 0 0 0 1 0 0 0 0 1\n",
            None,
        ),
        (OST, LENS),
        (SECTIONS, Lens((0.1, -0.2, 0.01, 0.02, 0, 0, 0, 0))),
        ("\n".join(f"{line}\r" for line in OST.split("\n")), LENS),
    ],
)
def test_the_output_of_camera_programs_is_accepted(text: str, lens: Lens | None) -> None:
    """pyrealsense2's two forms, Python's and NumPy's, Orbbec, Azure, RealSense Viewer, ScanNet,
    ROS's ost, sections.
    """
    found = parse(text, "x")
    assert (found.camera, found.lens) == (SIZED, lens)


def test_the_mode_of_a_camera_depends_on_the_size_of_frames(tmp_path: Path) -> None:
    """The whole text of rs-enumerate-devices -c, also as PowerShell writes it: the depth of
    the frames' size.
    """
    (tmp_path / "camera.txt").write_text(ENUMERATED, encoding="utf-16")
    for found in (parse(ENUMERATED, "x"), camera_file.read(tmp_path / "camera.txt")):
        assert isinstance(found.camera, View) and found.lens == Lens()
        assert found.camera.at(64, 48) == SIZED
        assert found.camera.at(128, 96) == Camera("own", 120, 122, 63.5, 47.5, 128, 96)
        with pytest.raises(
            DataError, match=r"32 x 24 pixels; .* has a camera for 64 x 48, 128 x 96"
        ):
            found.camera.at(32, 24)


@bad_inputs(
    DataError,
    {
        "two devices": (
            ENUMERATED + ENUMERATED.replace("Fy:         \t61", "Fy:         \t62"),
            "x: has several ...",
        ),
        "other lenses": (
            ENUMERATED.replace("0  \t0  \t0  \t0  \t0", "0.1  \t0  \t0  \t0  \t0", 1),
            "x: has several ...",
        ),
    },
)
def test_ambiguous_modes_are_rejected(given: str, rejected: Any) -> None:
    with rejected:
        parse(given, "x")
