"""handpose/frames/formats/folder.py"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.cameras import NYU
from handpose.frames.formats.folder import FolderRecording
from handpose.frames.images import ALIGNED, OTHER_KIND
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from tests.handpose.frames.conftest import CAMERA, GIVEN, hand_sized, middles, put, times_of
from tests.support.bad_input import bad_inputs
from tests.support.nyu_data_set import pack_depth

HERE = Path(__file__).parent
TWELVE = [500 + number / 2 for number in range(12)]  # the depths of as many frames


def test_frames_by_number(folder: Path) -> None:
    """Frames are in numerical order, a missing number is a gap in time, and depth is in mm."""
    recording = FolderRecording(folder, GIVEN)
    frames = list(recording)
    assert (recording.name, recording.count, recording.rate) == (str(folder), 3, 10)
    assert (recording.camera, recording.unit_mm, recording.cut) == (CAMERA, 0.5, "")
    assert [(frame.number, frame.time) for frame in frames] == [(0, 0.0), (1, 0.1), (2, 0.3)]
    assert middles(frames) == [500.5, 501, 502]
    assert recording.remarks == (
        "frames in the order of the numbers in their names; numbers missing between 1 and 4: 1, which stay gaps in "
        "time (--time-unit if they are times)",
        "camera own, by --camera",
    )
    recording = FolderRecording(folder, replace(GIVEN, rate=None))
    assert times_of(recording) == [0, 1 / 30, 0.1]
    assert recording.remarks[-1].startswith("rate unknown: 30 frames per second assumed")


def test_a_given_unit_of_the_times(here: Path) -> None:
    """Times that show no unit are numbers of frames, unless their unit is given, here or
    in camera.json.
    """
    for stamp in (5000, 5100, 5200):
        put(f"{stamp}.png", hand_sized())
    given = replace(GIVEN, rate=None)
    assert times_of(FolderRecording(here, given)) == pytest.approx([0, 100 / 30, 200 / 30])
    timed = FolderRecording(here, replace(given, time_unit="ms"))
    assert times_of(timed) == [0, 0.1, 0.2]
    assert timed.remarks[0] == "times from the file names, in ms as given: a frame every 100 ms"
    Path("camera.json").write_text('{"time_unit": "ms"}')
    assert times_of(FolderRecording(here, given)) == [0, 0.1, 0.2]
    counted = FolderRecording(here, replace(GIVEN, rate=100.0, time_unit="frames"))
    assert times_of(counted) == [0, 1, 2]


@pytest.mark.parametrize("suffix", [".tif", ".TIFF", ".PNG"])
def test_a_pattern_and_a_name(here: Path, suffix: str) -> None:
    """TIFF, and suffixes in capitals, are accepted."""
    for name in ("a_1", "a_2", "b_1"):
        put(f"{name}{suffix}", hand_sized())
    with pytest.raises(DataError, match="holds 2 sequences"):
        FolderRecording(here, GIVEN)
    assert FolderRecording(Path(f"a_*{suffix}"), GIVEN).count == 2
    assert middles(FolderRecording(Path(f"b_1{suffix}"), GIVEN)) == [500]


def test_camera_json(folder: Path) -> None:
    """camera.json in the folder is used, and given parameters take precedence."""
    camera_file.write(folder / "camera.json", CameraInfo(CAMERA, unit_mm=2.0, rate=5.0))
    recording = FolderRecording(folder)
    assert (recording.camera, recording.unit_mm, recording.rate) == (CAMERA, 2, 5)
    assert f"camera own, by {folder / 'camera.json'}" in recording.remarks
    assert FolderRecording(folder / "*.png", CameraInfo(unit_mm=1.0)).unit_mm == 1


@pytest.mark.parametrize(
    ("name", "left"), [("1.png", [(1, 0.1), (2, 0.3)]), ("2.png", [(0, 0.0), (2, 0.3)])]
)
def test_a_damaged_frame_is_skipped_and_reported(
    folder: Path, name: str, left: list[tuple[int, float]]
) -> None:
    """Its number and time are skipped, too, also those of the first frame."""
    path = folder / name
    path.write_bytes(path.read_bytes()[:-30])
    recording = FolderRecording(folder, GIVEN)
    before = recording.remarks
    for _ in range(2):
        assert [(frame.number, frame.time) for frame in recording] == left
        assert recording.remarks == (
            *before,
            f"1 damaged frames are left out, the first: {path}: truncated or damaged PNG",
        )


def test_a_folder_of_damaged_frames_is_an_error(folder: Path) -> None:
    for path in folder.iterdir():
        path.write_bytes(b"")
    with pytest.raises(DataError, match=r"1\.png: not an image"):
        FolderRecording(folder, GIVEN)


@bad_inputs(
    DataError,
    {
        "another size": (hand_sized((24, 32)), "...2.png: 32 x 24 pixels; the camera has 64 x 48"),
        "8 bits": (
            np.zeros((48, 64), np.uint8),
            "...2.png: a picture of uint8 grey values; expected depth, a 16-bit grey picture",
        ),
        "colours": (
            np.zeros((48, 64, 3), np.uint8),
            "...2.png: a picture of uint8 colours; expected depth, a 16-bit grey ...",
        ),
        "16-bit colours": (
            np.zeros((48, 64, 3), np.uint16),
            "...2.png: a picture of uint16 colours; expected depth, a 16-bit grey ...",
        ),
    },
)
def test_a_picture_of_another_size_or_type_is_an_error(
    folder: Path, given: np.ndarray, rejected: Any
) -> None:
    """It is not skipped as damaged."""
    put(folder / "2.png", given)
    with rejected:
        list(FolderRecording(folder, GIVEN))


@pytest.mark.parametrize(
    "form", ["{}_{}.png", "{} ({}).png", "[{}] {}.png", "{}[{}].tif", "what?{}*{}.png"]
)
def test_the_pattern_in_the_error_names_the_depth(here: Path, form: str) -> None:
    """Names without leading zeros, infrared files in between, special characters in the path."""
    for number in range(12):
        put(Path("a [b]", form.format("depth", number)), hand_sized(distance=1000 + number))
        put(Path("a [b]", form.format("ir", number)), hand_sized(distance=3000))
    with pytest.raises(DataError, match="holds 2 sequences") as raised:
        FolderRecording(Path("a [b]"), GIVEN)
    pattern = str(raised.value).partition("; name one, as '")[2].removesuffix("'")
    recording = FolderRecording(Path(pattern), GIVEN)
    assert middles(recording) == TWELVE


def test_the_packing_of_nyu(here: Path) -> None:
    image = pack_depth(np.full((480, 640), 700))
    for name in ("depth_1_0000001", "rgb_1_0000001"):
        put(f"{name}.png", image)
    recording = FolderRecording(Path("depth_1_*.png"), CameraInfo(NYU))
    assert (recording.camera, recording.unit_mm, recording.count) == (NYU, 1, 1)
    assert [float(frame.depth.mean()) for frame in recording] == [700]
    put("red.png", image[..., [2, 1, 0]])  # as in STB and HO-3D
    for given in CameraInfo(NYU), GIVEN:
        with pytest.raises(DataError, match=r"in red and none in blue.*256 \* green \+ red"):
            FolderRecording(Path("red.png"), given)


def test_a_photograph_is_no_packed_depth(here: Path, rng: np.random.Generator) -> None:
    put("rgb_1_0000001.png", rng.integers(1, 255, (480, 640, 3), np.uint8))
    with pytest.raises(DataError, match="a picture of colours; NYU's packed depth has no red"):
        FolderRecording(here, CameraInfo(NYU))


@pytest.mark.parametrize(
    ("place", "is_warned"),
    [
        ("disparity/000000.png", True),
        ("take/left_disp_000000.png", True),
        ("depth/IR_1.png", True),
        ("disparity_and_depth/000000.png", False),
        ("ir/depth_000000.png", False),
        ("display/air1.png", False),
    ],
)
def test_frames_of_another_kind_by_their_names(here: Path, place: str, is_warned: bool) -> None:
    put(place, hand_sized())
    assert (OTHER_KIND in FolderRecording(Path(place), GIVEN).warnings) == is_warned


def test_the_pattern_in_an_error_names_one_sequence(here: Path) -> None:
    """Its stars stand for numbers where there are such names, as of HoloLens 2's TIME.pgm
    and TIME_ab.pgm.
    """
    for number in range(3):
        put(f"{number}.png", hand_sized(distance=1000 + number))
        put(f"{number}_ab.png", hand_sized(distance=3000))
    with pytest.raises(DataError, match=r"; name one, as '.*\*\.png'") as raised:
        FolderRecording(here, GIVEN)
    pattern = str(raised.value).partition("; name one, as '")[2].removesuffix("'")
    assert middles(FolderRecording(Path(pattern), GIVEN)) == TWELVE[:3]
    assert middles(FolderRecording(here / "*_ab.png", GIVEN)) == [1500] * 3


@pytest.mark.parametrize(
    ("place", "is_warned"),
    [
        ("take/aligned_depth_to_color_000000.png", True),
        ("depthAligned/000000.png", True),
        ("unaligned/000000.png", False),
        ("alignment/000000.png", False),
    ],
)
def test_frames_aligned_to_colours(here: Path, place: str, is_warned: bool) -> None:
    """As in DexYCB, whose files have the cameras of depth and of colours; four given numbers and
    those of a camera.json were chosen.
    """
    put(place, hand_sized())
    in_file = replace(GIVEN, origin="K.txt (matrix)")
    folder = Path(place).parent
    assert (ALIGNED in FolderRecording(folder, in_file).warnings) == is_warned
    assert ALIGNED not in FolderRecording(folder, GIVEN).warnings
    camera_file.write(folder / "camera.json", GIVEN)
    assert ALIGNED not in FolderRecording(folder).warnings


# ------------------------------------------------------------------------------------------- arrays


def put_array(name: str, values: np.ndarray, **others: Any) -> None:
    """Write an array to a file of the name's kind."""
    path = Path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".npz":
        np.savez(path, **{**others, "depth": values})
    elif path.suffix.lower() == ".npy":
        np.save(path, values)
    else:
        values.tofile(path)


@pytest.mark.parametrize("kind", ["npy", "npz", "raw"])
def test_an_array_for_each_frame(here: Path, kind: str) -> None:
    """In the order of the numbers in their names, which have no leading zeros."""
    for number in range(12):
        put_array(f"depth_{number}.{kind}", hand_sized(distance=1000 + number))
    recording = FolderRecording(here, GIVEN)
    assert (recording.count, recording.camera, recording.rate) == (12, CAMERA, 10)
    assert recording.warnings == ()
    for _ in range(2):
        assert middles(recording) == TWELVE
    assert times_of(recording) == pytest.approx([number / 10 for number in range(12)])
    assert FolderRecording(Path(f"depth_1*.{kind}"), GIVEN).count == 3


def test_times_in_the_names_of_arrays(here: Path) -> None:
    for time in (1616799936158, 1616799936125, 1616799936191):
        put_array(f"x_Depth_{time}.25000000000000.raw", hand_sized())
    assert times_of(FolderRecording(here, GIVEN)) == pytest.approx([0, 0.033, 0.066])


@pytest.mark.parametrize(
    "values",
    [
        hand_sized().astype(">u2"),
        hand_sized().astype(np.float32),
        hand_sized().astype(np.int32),
        hand_sized()[None],
        hand_sized()[..., None],
        np.asfortranarray(hand_sized()),
    ],
    ids=["big endian", "float32", "int32", "an axis in front", "an axis behind", "by columns"],
)
@pytest.mark.parametrize("kind", ["npy", "npz"])
def test_types_of_arrays(here: Path, values: np.ndarray, kind: str) -> None:
    put_array(f"1.{kind}", values)
    (frame,) = FolderRecording(here, GIVEN)
    np.testing.assert_array_equal(frame.depth, hand_sized() / np.float32(2))


@pytest.mark.parametrize("kind", ["npy", "raw"])
def test_infrared_is_not_joined_into_depth(tmp_path: Path, kind: str) -> None:
    """Two kinds of 16 bits in one folder are two sequences, as of pictures."""
    for number in range(3):
        put_array(tmp_path / f"depth_{number}.{kind}", hand_sized(distance=1000 + number))
        put_array(tmp_path / f"infrared_{number}.{kind}", hand_sized(distance=3000))
    with pytest.raises(
        DataError, match=rf"holds 2 sequences: .*; name one, as '{tmp_path}/depth_\*\.{kind}'"
    ):
        FolderRecording(tmp_path, GIVEN)
    recording = FolderRecording(tmp_path / f"depth_*.{kind}", GIVEN)
    assert middles(recording) == [500, 500.5, 501]


@pytest.mark.parametrize("depth", ["depth_{}.npy", "{}.png", "{}.npz"])
def test_arrays_of_other_data_are_ignored(here: Path, depth: str) -> None:
    """Colours, 8-bit infrared, a matrix, joints and a whole take; also if the first
    frame is damaged.
    """
    for number in range(3):
        path = Path(depth.format(number))
        values = hand_sized(distance=1000 + number)
        put(path, values) if path.suffix == ".png" else put_array(path, values)
        put_array(f"color_{number}.npy", np.zeros((48, 64, 3), np.uint8))
        put_array(f"ir_{number}.npy", np.zeros((48, 64), np.uint8))
        put_array(f"joints_{number}.npy", np.zeros((21, 3)))
        np.savez(f"labels_{number}.npz", seg=np.zeros((48, 64), np.uint8), pose=np.zeros((1, 51)))
    np.save("K.npy", np.eye(3))
    np.savez("take.npz", depth=np.zeros((3, 48, 64), np.uint16))
    assert middles(FolderRecording(here, GIVEN)) == [500, 500.5, 501]
    Path(depth.format(0)).write_bytes(b"")
    assert middles(FolderRecording(here, GIVEN)) == [500.5, 501]


def test_archives_of_frames_may_contain_the_camera(here: Path) -> None:
    """The camera of the first archive is used. Unused arrays are named in a warning."""
    others = {
        "K": [[60, 0, 31.5], [0, 61, 23.5], [0, 0, 1]],
        "color": np.zeros((48, 64, 3), np.uint8),
    }
    for number in range(3):
        put_array(f"frame_{number}.npz", hand_sized(distance=1000 + number), **others)
    recording = FolderRecording(here)
    assert (recording.camera, recording.unit_mm) == (CAMERA, 1)
    assert recording.remarks[1] == "parameters from 'K'"
    assert recording.warnings[0].startswith("array 'color' is not used")
    assert FolderRecording(here, CameraInfo(replace(CAMERA, fx=70.0))).camera.fx == 70


def test_parameters_in_groups_of_an_archive_are_used(here: Path) -> None:
    parameters = {"camera.fx": 60, "camera.fy": 61, "camera.cx": 31.5, "camera.cy": 23.5}
    put_array("frame_0.npz", hand_sized(), **parameters)
    recording = FolderRecording(here)
    assert (recording.camera, recording.warnings) == (CAMERA, ())


@pytest.mark.parametrize(
    ("name", "values", "unit", "times"),
    [
        ("timestamp_ms", (7, 40, 106), None, [0, 0.033, 0.099]),
        ("timestamp", (1616799936.125, 1616799936.25, 1616799936.5), None, [0, 0.125, 0.375]),
        ("time", np.array([[7.5], [8.5], [9.0]]), None, [0, 1, 1.5]),
        ("timestamp", (7.5, 8.5, 9.0), "s", [0, 1, 1.5]),
        ("t", (3, 4, 6), "frames", [0, 0.1, 0.3]),
    ],
)
def test_times_in_the_archives_of_frames(
    here: Path, name: str, values: Any, unit: str | None, times: list[float]
) -> None:
    """If the names have none; also if a frame is damaged, which is left out."""
    for number, time in enumerate(values):
        put_array(f"{number + 8}.npz", hand_sized(distance=1000 + number), **{name: time})
    given = replace(GIVEN, time_unit=unit)
    recording = FolderRecording(here, given)
    assert times_of(recording) == pytest.approx(times)
    assert middles(recording) == [500, 500.5, 501]
    assert recording.remarks[0].startswith(f"times from '{name}' of each frame, ")
    assert recording.warnings == ()
    Path("9.npz").write_bytes(b"")
    assert times_of(FolderRecording(here, given)) == pytest.approx(times[::2])
    for number, time in enumerate(values):
        put_array(f"{(number + 1) * 100}us.npz", hand_sized(), **{name: time})
    assert times_of(FolderRecording(Path("*us.npz"), GIVEN)) == pytest.approx([0, 1e-4, 2e-4])


@bad_inputs(
    DataError,
    {
        "descending": (
            (2, 1),
            "...: timestamp_ms[1] is 1; expected finite times, each after the one before",
        ),
        "missing": (
            (1, None),
            "...: timestamp_ms is float64 (1,), expected (2,): a time for each frame",
        ),
    },
)
def test_times_in_archives_that_do_not_fit(
    here: Path, given: tuple[Any, Any], rejected: Any
) -> None:
    for number, time in enumerate(given):
        others = {} if time is None else {"timestamp_ms": time}
        put_array(f"{number}.npz", hand_sized(), **others)
    with rejected:
        FolderRecording(here, GIVEN)


def test_raw_values_have_the_size_of_the_camera(here: Path) -> None:
    """By camera.json next to them, also if the user gives focal lengths alone."""
    put_array("1.raw", hand_sized())
    camera_file.write(Path("camera.json"), CameraInfo(CAMERA, unit_mm=2.0))
    assert middles(FolderRecording(here)) == [2000]
    given = CameraInfo(replace(CAMERA, fx=70.0, width=0, height=0))
    assert FolderRecording(here, given).camera.fx == 70


@bad_inputs(
    DataError,
    {
        "bytes": (
            ("1.npy", np.zeros((48, 64), np.uint8)),
            "...1.npy: values of type uint8; expected depths, of 16 bits or more",
        ),
        "colours": (
            ("1.npy", np.zeros((48, 64, 3), np.uint8)),
            "...1.npy: an array of shape (48, 64, 3); expected (height, width); a file with several frames is ...",
        ),
        "a whole take": (
            ("1.npy", np.zeros((5, 48, 64), np.uint16)),
            "...1.npy: an array of shape (5, 48, 64); expected ...",
        ),
        "one value": (
            ("1.npy", np.uint16(7)),
            "...1.npy: an array of shape (); expected (height, width); ...",
        ),
        "complex": (
            ("1.npz", np.zeros((48, 64), complex)),
            "...1.npz: values of type complex128; expected depths, of 16 ...",
        ),
        "raw bytes": (
            ("1.raw", np.zeros((48, 64), np.uint8)),
            "...1.raw: 3072 bytes; expected 6144, 64 x 48 depths of 16 bits without a header",
        ),
        "raw float32": (
            ("1.raw", np.zeros((48, 64), np.float32)),
            "...1.raw: 12288 bytes; expected 6144, 64 x 48 depths ...",
        ),
    },
)
@pytest.mark.parametrize("is_later", [False, True])
def test_arrays_other_than_depth_are_rejected(
    here: Path, given: tuple[str, Any], is_later: bool, rejected: Any
) -> None:
    """In one line, also of a later frame, which is not taken for a damaged one."""
    name, values = given
    put_array(name, values)
    if is_later:
        put_array(Path("0").with_suffix(Path(name).suffix), hand_sized())
    with rejected:
        list(FolderRecording(here, GIVEN))


def test_two_arrays_in_an_archive(here: Path) -> None:
    np.savez("1.npz", a=hand_sized(), b=hand_sized())
    with pytest.raises(
        DataError,
        match=r"1\.npz: holds a \(48, 64\), b \(48, 64\); expected an array depth \(height",
    ):
        FolderRecording(here, GIVEN)


def test_raw_values_of_two_sizes_of_the_camera(here: Path) -> None:
    """640 x 360 and 480 x 480, which D400 cameras have, are equally many bytes."""
    modes = [
        {"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5, "width": width, "height": height}
        for width, height in ((64, 48), (48, 64), (64, 64))
    ]
    Path("camera.json").write_text(json.dumps({"depth": modes}))
    put_array("1.raw", hand_sized())
    with pytest.raises(
        DataError,
        match=r"6144 bytes; expected 6144, 64 x 48, 6144, 48 x 64 .*; give a camera of one",
    ):
        FolderRecording(here)
    Path("1.raw").write_bytes(bytes(2 * 64 * 64))
    assert FolderRecording(here).camera.height == 64


def test_raw_values_of_unknown_size(here: Path) -> None:
    put_array("1.raw", hand_sized())
    with pytest.raises(
        DataError,
        match=r"1\.raw: 6144 bytes without a header, of unknown height and width; give them",
    ):
        FolderRecording(here, CameraInfo(replace(CAMERA, width=0, height=0)))


# ------------------------------------------------------------------------------------------- errors


def tiff(path: Path, count: int) -> None:
    """Write a TIFF of several pictures."""
    cv2.imwritemulti(str(path), [hand_sized()] * count)


@bad_inputs(
    DataError,
    {
        "an empty folder": (((), ""), "...: holds no depth frames (...); found nothing"),
        "other pictures": (
            (("a.jpg", "b.JPG", ".1.png"), ""),
            "...: holds no depth frames (...); found a.jpg, b.JPG; of other formats write the depth with Python: ...",
        ),
        "folders": (
            (("depth/1.png", "rgb/1.png"), ""),
            "...: holds no depth frames (...); found depth, rgb; name the folder of the "
            "frames, as '.../depth'",
        ),
        "another pattern": (
            (("left_1.png",), "lefts_*.png"),
            ".../lefts_*.png: no frame has such a name (did you mean 'left_1.png'?)",
        ),
        "another name": (
            (("frames_a/1.png",), "frame_a"),
            ".../frame_a: no such file or folder (did you mean 'frames_a'?)",
        ),
        "a TIFF of two pictures": (
            (("1.tif",), ""),
            ".../1.tif: a TIFF of 2 pictures; expected one for each frame, or all in an .npy",
        ),
    },
)
def test_folders_without_depth_frames_are_rejected(
    tmp_path: Path, given: tuple[tuple[str, ...], str], rejected: Any
) -> None:
    """The error names what was found instead, before any frame is read."""
    names, source = given
    for name in names:
        if name.endswith(".tif"):
            tiff(tmp_path / name, 2)
        else:
            put(tmp_path / name, hand_sized())
    with rejected:
        FolderRecording(tmp_path / source, GIVEN)
