"""tools/common/sources.py: the options that describe a camera, and the summary of a recording."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from handpose.frames.cameras import SR305, Camera
from handpose.frames.inspection import inspect
from netlib.errors import DataError
from tools.common.sources import add_source_options, opened, print_inspection, print_warnings


@pytest.fixture
def frames(here: Path) -> None:
    """Two frames with the size of the SR305 camera."""
    for i in range(2):
        cv2.imwrite(f"{i}.png", np.full((480, 640), 4000 + i, np.uint16))


def parsed(options: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_source_options(parser)
    return parser.parse_args(["*.png", *options.split()])


def test_a_camera_is_given_by_name_numbers_or_file(frames: None) -> None:
    """A camera may be a name, numbers or a file; options on the command line take precedence."""
    assert opened(parsed("--camera sr305")).camera == SR305
    assert opened(parsed("--camera sr305")).unit_mm == 0.125
    assert opened(parsed("--camera 500,501,320,240")).camera == Camera(
        "own", 500, 501, 320, 240, 640, 480
    )
    Path("c.json").write_text(
        '{"fx": 500, "fy": 501, "u0": 320, "v0": 240, "unit_mm": 0.5, "rate": 60}'
    )
    recording = opened(parsed("--camera c.json --unit 0.25"))
    assert (recording.camera.fx, recording.unit_mm, recording.rate) == (500, 0.25, 60)


def test_a_camera_file_of_another_program_is_read(
    frames: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Any name; the report says what was taken from it."""
    Path("narrow").write_text(
        "image_width: 640\nimage_height: 480\nK: [500, 0, 320, 0, 501, 240, 0, 0, 1]\nseq: 3\n"
    )
    recording = opened(parsed("--camera narrow"))
    assert recording.camera == Camera("own", 500, 501, 320, 240, 640, 480)
    assert (
        "camera own, by narrow (image_width, image_height, K; not used: seq)" in recording.remarks
    )
    Path("narrow").rename("K.txt")
    assert opened(parsed("")).camera == recording.camera  # found in the folder of the frames


@pytest.mark.parametrize(
    ("option", "name", "fx", "fy"),
    [
        ("--fov 90", "of 90 degrees", 320, 320),
        ("--fov 90,60", "of 90,60 degrees", 320, 240 * 3**0.5),
        ("--camera d435", "d435", 384, 384),
        ("--camera D415", "d415", 616, 616),
        ("--camera kinect1", "kinect1", 576, 576),
    ],
)
def test_a_field_of_view_gives_a_camera(
    frames: None, option: str, name: str, fx: float, fy: float
) -> None:
    """The principal point is in the middle; the report says that it is a guess."""
    recording = opened(parsed(option))
    camera = recording.camera
    assert (camera.name, camera.width, camera.height) == (name, 640, 480)
    assert (camera.u0, camera.v0) == (319.5, 239.5)
    assert (camera.fx, camera.fy) == pytest.approx((fx, fy), rel=5e-3)
    said = f"camera {name}: focal lengths {camera.fx:.0f}, {camera.fy:.0f} px by the field of view alone, often 5% off"
    assert any(remark.startswith(said) for remark in recording.remarks)


def test_frames_of_another_size_than_the_cameras_are_rejected(frames: None) -> None:
    """The error names the file."""
    said = {"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
    Path("intrinsics.json").write_text(json.dumps(said))
    with pytest.raises(DataError, match=r"camera own has 64 x 48, by \S*intrinsics\.json \("):
        opened(parsed(""))


def test_lens_distortion_is_removed(frames: None) -> None:
    """Lens distortion is removed and mentioned in the remarks."""
    recording = opened(parsed("--camera sr305 --distortion=-0.1,0.2,0,0"))
    assert "the distortion of the lens is taken out" in recording.remarks


@pytest.mark.parametrize(
    ("argv", "what"),
    [
        ("--camera sr306", "expected a file, nyu, icvl, msra15, kinect2, sr305, d405, "),
        ("--unit 1e-320", "expected a number greater than 1e-06 and at most 10000, found '1e-320'"),
        ("--rate inf", "expected a number greater than 1e-06 and at most 10000, found 'inf'"),
        ("--fov 0", "expected degrees between 1 and 179"),
        ("--fov 60 --camera sr305", "not allowed with argument --fov"),
        ("--distortion a,b,c,d", "expected 4, 5 or 8 numbers K1,K2,P1,P2"),
    ],
)
def test_invalid_options_are_rejected(
    argv: str, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        parsed(argv)
    assert stopped.value.code == 2
    assert what in capsys.readouterr().err


def test_the_summary_is_on_stdout_and_warnings_are_on_stderr(
    frames: None, capsys: pytest.CaptureFixture[str]
) -> None:
    print_inspection(inspect(opened(parsed("--camera sr305 --rate 60"))))
    assert capsys.readouterr().out.splitlines() == [
        "*.png: 2 frames, 640 x 480 pixels, 60 frames/s",
        "  camera sr305: fx 476.007, fy 476.007, u0 313.68, v0 242.76; field of view 68 x 54 degrees",
        "  depth 500 to 500 mm, median 500; 0% of the pixels empty; unit 0.125 mm",
        "  nearest object: 500 mm away, 647 mm wide",
        "  frames in the order of the numbers in their names",
        "  camera sr305, by --camera",
    ]
    print_inspection(inspect(opened(parsed("--camera sr305 --unit 10"))))
    assert (
        "warning: *.png: the nearest object is 40 m away and 51.8 m wide" in capsys.readouterr().err
    )


def test_a_hand_that_was_found_confirms_the_unit(capsys: pytest.CaptureFixture[str]) -> None:
    """A forearm nearer than usual gives no warning about the unit if the fit has a
    high confidence.
    """
    depth = np.full((480, 640), 82, np.float32)
    for confidence, warnings in ((0.0, 1), (0.82, 1), (float("nan"), 1), (0.99, 0)):
        print_warnings("frame.png", depth, SR305, 1.0, confidence)
        assert capsys.readouterr().err.count("check the unit, here 1 mm") == warnings
