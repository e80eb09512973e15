"""handpose/frames/opening.py: the reader for each kind of source."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.frames import formats
from handpose.frames.formats.folder import FolderRecording
from handpose.frames.formats.stack import StackRecording
from handpose.frames.opening import open_recording
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError
from tests.handpose.frames.conftest import GIVEN, hand_sized
from tests.support.bad_input import bad_inputs
from tests.support.running import run_python


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, object, CameraInfo]]:
    """The calls of readers that need packages; the readers themselves are replaced."""
    found: list[tuple[str, object, CameraInfo]] = []
    live = [(module, "open_live") for module in ("realsense", "orbbec", "oak", "ros2")]
    for module, name in (("video", "open_video"), ("ros_bag", "open_bag"), *live):

        def opened(source: object, given: CameraInfo, name: str = name) -> None:
            found.append((name, source, given))

        replaced = SimpleNamespace(**{name: opened})
        monkeypatch.setitem(sys.modules, f"handpose.frames.formats.{module}", replaced)
        monkeypatch.setattr(formats, module, replaced, raising=False)
    return found


def test_folders_and_pictures(folder: Path) -> None:
    """Folders, patterns and pictures are accepted as paths and as text."""
    for source in (folder, str(folder), folder / "*.png", folder / "1.png"):
        with open_recording(source, GIVEN) as recording:
            assert isinstance(recording, FolderRecording)


def test_stacks(tmp_path: Path) -> None:
    """Suffixes in capitals are accepted."""
    np.save(tmp_path / "a.npy", hand_sized()[None])
    (tmp_path / "a.npy").rename(tmp_path / "B.NPY")
    assert isinstance(open_recording(tmp_path / "B.NPY", GIVEN), StackRecording)


@pytest.mark.parametrize(
    ("name", "reader"),
    [("a.mkv", "open_video"), ("A.AVI", "open_video"), ("a.bag", "open_bag"), ("a.mcap", "open_bag")],
)
def test_containers(tmp_path: Path, asked: list[tuple[str, object, CameraInfo]], name: str, reader: str) -> None:
    """Containers are opened by readers that are imported on demand."""
    (tmp_path / name).touch()
    open_recording(tmp_path / name, GIVEN)
    assert asked == [(reader, tmp_path / name, GIVEN)]


def test_a_bag_that_is_a_folder(tmp_path: Path, asked: list[tuple[str, object, CameraInfo]]) -> None:
    """A folder with metadata.yaml is opened as a bag of ROS 2."""
    (tmp_path / "metadata.yaml").touch()
    open_recording(tmp_path)
    assert asked == [("open_bag", tmp_path, UNKNOWN)]


@pytest.mark.parametrize("kind", ["realsense", "orbbec", "oak", "ros2"])
def test_a_live_camera(asked: list[tuple[str, object, CameraInfo]], kind: str) -> None:
    """The first camera is opened, or the one with a serial number or topic."""
    open_recording(kind)
    open_recording(f"{kind}:/a:b", GIVEN)
    assert asked == [("open_live", None, UNKNOWN), ("open_live", "/a:b", GIVEN)]


@bad_inputs(DataError, {
    name: f"{name}: its times have a unit; --time-unit is for the names of images and for arrays"
    for name in ("a.mkv", "a.bag", "realsense", "oak")
})
def test_a_unit_of_times_where_there_is_none(
    tmp_path: Path, asked: list[Any], monkeypatch: pytest.MonkeyPatch, given: str, rejected: Any
) -> None:
    """Sources with a clock of their own reject a given unit of times."""
    monkeypatch.chdir(tmp_path)
    if "." in given:
        Path(given).touch()
    with rejected:
        open_recording(given, CameraInfo(time_unit="ms"))
    assert not asked


@bad_inputs(DataError, {
    **{name: f"{name}: no such file" for name in ("none.npz", "none.mkv", "none.bag")},
    **{name: f"{name}: no such file or folder" for name in ("none", "none/of/these.png")},
    "a.raw": "a.raw: values without a header, as rs-convert -r ...(rs-convert -p), or convert them, ...: python -c ...",
    "a.txt": "a.txt: not a recording; expected a folder of 16-bit PNG, ..., .npz, ...: realsense, orbbec or oak...",
})
def test_what_is_no_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str, rejected: Any, asked: list[Any]
) -> None:
    """A missing or unknown file raises an error before any reader is imported."""
    monkeypatch.chdir(tmp_path)
    Path("a.txt").touch()
    Path("a.raw").touch()
    with rejected:
        open_recording(given)
    assert not asked


def test_the_line_that_converts_raw_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    values = np.arange(2 * 480 * 640, dtype=np.uint16).reshape(2, 480, 640)
    for number, frame in enumerate(values):
        frame.tofile(f"{number}.raw")
    with pytest.raises(DataError, match=r"holds no depth frames .*, but \.raw: values without a header") as error:
        open_recording(tmp_path)
    code = str(error.value).partition(' -c "')[2].removesuffix('"')
    run_python("-c", code, cwd=tmp_path)
    np.testing.assert_array_equal(np.load("take.npy"), values)
