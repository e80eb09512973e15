"""handpose/frames/formats/__init__.py: the reader for each kind of source."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from handpose.frames import camera_file
from handpose.frames.formats import open_recording, realsense, ros_bag
from handpose.frames.formats.folder import FolderRecording
from handpose.frames.formats.stack import StackRecording
from handpose.frames.recording import CameraInfo, Recording
from netlib.errors import DataError
from tests.handpose.frames.conftest import GIVEN, hand_sized, put
from tests.support.bad_input import bad_inputs
from tests.support.running import run_python


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, object, CameraInfo]]:
    """The calls of readers that need packages; the readers themselves are replaced."""
    found: list[tuple[str, object, CameraInfo]] = []
    for owner, name in ((ros_bag, "BagRecording"), (realsense, "open_live")):
        monkeypatch.setattr(owner, name, lambda source, given, name=name: found.append((name, source, given)))
    return found


@pytest.mark.parametrize(("source", "kind"), [
    ("frames", FolderRecording), ("frames/*.png", FolderRecording), (Path("frames/1.png"), FolderRecording),
    ("B.NPY", StackRecording),  # suffixes in capitals are accepted
])
def test_readers_of_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str | Path, kind: type[Recording]
) -> None:
    monkeypatch.chdir(tmp_path)
    put(Path("frames/1.png"), hand_sized())
    np.save("b.npy", hand_sized()[None])
    Path("b.npy").rename("B.NPY")
    with open_recording(source, GIVEN) as recording:
        assert isinstance(recording, kind)


@pytest.mark.parametrize(("source", "calls"), [
    ("a.bag", ("BagRecording", Path("a.bag"))), ("A.MCAP", ("BagRecording", Path("A.MCAP"))),
    ("bag", ("BagRecording", Path("bag"))),  # a folder
    ("realsense", ("open_live", None)), ("realsense:/a:b", ("open_live", "/a:b")),
])
def test_readers_that_need_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: list[Any], source: str, calls: tuple[str, object]
) -> None:
    """Of bags, and of the first camera or that with a serial number."""
    monkeypatch.chdir(tmp_path)
    Path("bag").mkdir()
    for name in ("a.bag", "A.MCAP", "bag/metadata.yaml"):
        Path(name).touch()
    open_recording(source, GIVEN)
    assert asked == [(*calls, GIVEN)]


@bad_inputs(DataError, {
    name: f"{name}: its times have a unit; --time-unit is for the names of images and for arrays"
    for name in ("a.bag", "realsense")
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
    "a null character": ("a\0b", r"a\x00b: no such file or folder"),
    "5000 letters": ("x" * 5000, "xxx...xxx: no such file or folder"),
    "loop": "loop: no such file or folder (did you mean 'loop'?)",
    "a.raw": "a.raw: values without a header, as rs-convert -r ...(rs-convert -p), or give their height and width; ...",
    "a.txt": "a.txt: not a recording; expected a folder of 16-bit PNG, ..., .npz, ...: realsense or realsense:SERIAL",
})
def test_what_is_no_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str, rejected: Any, asked: list[Any]
) -> None:
    """A missing or unknown file raises an error before any reader is asked."""
    monkeypatch.chdir(tmp_path)
    Path("a.txt").touch()
    Path("a.raw").touch()
    Path("loop").symlink_to("loop")
    with rejected:
        open_recording(given)
    assert not asked


def converted(source: Path | str, said: str) -> None:
    """Run the Python statement in the error for a source."""
    with pytest.raises(DataError, match=said) as raised:
        open_recording(source)
    run_python("-c", str(raised.value).partition('; this converts: python -c "')[2].removesuffix('"'), cwd=Path())


def test_videos_are_converted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As tools/record.py wrote them once: every value, the times to 1 ms, and the camera in a tag."""
    av = pytest.importorskip("av", reason="PyAV is missing: pip install av")
    monkeypatch.chdir(tmp_path)
    depth = [hand_sized(distance=1000 + i) for i in range(3)]
    with av.open("take.mkv", "w", format="matroska") as video:
        video.metadata["CAMERA"] = camera_file.to_text(GIVEN)
        stream = video.add_stream("ffv1", rate=30, options={"level": "3", "g": "1"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "gray16le"
        stream.codec_context.time_base = Fraction(1, 1000)
        for milliseconds, values in zip((0, 33, 100), depth):
            picture = av.VideoFrame.from_ndarray(values.astype("<u2"), format="gray16le")
            picture.pts, picture.time_base = milliseconds, Fraction(1, 1000)
            video.mux(stream.encode(picture))
        video.mux(stream.encode(None))
    converted("take.mkv", "^take.mkv: a video; ")
    with open_recording("frames") as recording:
        assert (recording.camera, recording.unit_mm) == (GIVEN.camera, GIVEN.unit_mm)
        assert [frame.time for frame in recording] == pytest.approx([0, 0.033, 0.1])
        np.testing.assert_array_equal([frame.depth for frame in recording], np.array(depth) / np.float32(2))


def test_hdf5_is_converted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with h5py.File("take.h5", "w") as file:
        file["depth"], file["timestamps_ms"] = hand_sized()[None], [5]
        file.attrs.update(fx=60.0, fy=61.0, cx=31.5, cy=23.5)
    converted("take.h5", "^take.h5: HDF5; ")
    assert open_recording("frames.npz").camera.fy == 61


@pytest.mark.parametrize(("kind", "said", "take"), [
    ("raw", "values without a header", "take.npy"), ("npy", "a file for each frame", "../take.npy"),
])
def test_files_of_single_frames_are_joined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, said: str, take: str
) -> None:
    (tmp_path / "frames").mkdir()
    monkeypatch.chdir(tmp_path / "frames")
    values = np.arange(2 * 480 * 640, dtype=np.uint16).reshape(2, 480, 640)
    for number, frame in enumerate(values):
        frame.tofile(f"{number}.raw") if kind == "raw" else np.save(f"{number}.npy", frame)
    converted(Path(), rf"holds no depth frames .*; found 0\.{kind}, 1\.{kind}: {said}")
    np.testing.assert_array_equal(np.load(take), values)
