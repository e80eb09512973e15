"""handpose/frames/formats/__init__.py: the reader for each kind of source."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io

from handpose.frames import camera_file
from handpose.frames.formats import open_recording, realsense, ros_bag
from handpose.frames.formats.folder import FolderRecording
from handpose.frames.formats.stack import StackRecording
from handpose.frames.recording import CameraInfo, Recording
from netlib.errors import DataError, NetlibError
from tests.handpose.frames.conftest import GIVEN, hand_sized, middles, put, times_of
from tests.support.bad_input import bad_inputs
from tests.support.running import run_python

pytestmark = pytest.mark.usefixtures("here")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, object, CameraInfo]]:
    """The calls of readers that need packages; the readers themselves are replaced."""
    found: list[tuple[str, object, CameraInfo]] = []
    for owner, name in ((ros_bag, "BagRecording"), (realsense, "open_live")):
        monkeypatch.setattr(
            owner, name, lambda source, given, name=name: found.append((name, source, given))
        )
    return found


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        ("frames", FolderRecording),
        ("frames/*.png", FolderRecording),
        (Path("frames/1.png"), FolderRecording),
        ("arrays", FolderRecording),
        ("arrays/*.npy", FolderRecording),
        ("2.raw", FolderRecording),
        ("B.NPY", StackRecording),  # suffixes in capitals are accepted
    ],
)
def test_readers_of_files(source: str | Path, kind: type[Recording]) -> None:
    put(Path("frames/1.png"), hand_sized())
    Path("arrays").mkdir()
    np.save("arrays/1.npy", hand_sized())
    hand_sized().tofile("2.raw")
    np.save("b.npy", hand_sized()[None])
    Path("b.npy").rename("B.NPY")
    with open_recording(source, GIVEN) as recording:
        assert isinstance(recording, kind)


@pytest.mark.parametrize(
    ("source", "calls"),
    [
        ("a.bag", ("BagRecording", Path("a.bag"))),
        ("A.MCAP", ("BagRecording", Path("A.MCAP"))),
        ("bag", ("BagRecording", Path("bag"))),  # a folder
        ("realsense", ("open_live", None)),
        ("realsense:/a:b", ("open_live", "/a:b")),
    ],
)
def test_readers_that_need_packages(
    asked: list[Any], source: str, calls: tuple[str, object]
) -> None:
    """Of bags, and of the first camera or that with a serial number."""
    Path("bag").mkdir()
    for name in ("a.bag", "A.MCAP", "bag/metadata.yaml"):
        Path(name).touch()
    open_recording(source, GIVEN)
    assert asked == [(*calls, GIVEN)]


@bad_inputs(
    DataError,
    {
        name: f"{name}: its times have a unit; --time-unit is for the names of images and for arrays"
        for name in ("a.bag", "realsense")
    },
)
def test_sources_with_a_clock_reject_a_unit_of_times(
    asked: list[Any], given: str, rejected: Any
) -> None:
    if "." in given:
        Path(given).touch()
    with rejected:
        open_recording(given, CameraInfo(time_unit="ms"))
    assert not asked


def test_a_camera_without_its_info_is_rejected() -> None:
    with pytest.raises(NetlibError, match="given is a Camera; expected a CameraInfo"):
        open_recording("frames", GIVEN.camera)  # type: ignore[arg-type]


@bad_inputs(
    DataError,
    {
        **{
            name: f"{name}: no such file"
            for name in ("none.npz", "none.mkv", "none.bag", "none.raw")
        },
        **{name: f"{name}: no such file or folder" for name in ("none", "none/of/these.png")},
        "no name": ("", "the recording has no name; expected a folder, a file or a live camera"),
        "a null character": ("a\0b", r"a\x00b: no such file or folder"),
        "5000 letters": ("x" * 5000, "xxx...xxx: no such file or folder"),
        "loop": "loop: no such file or folder (did you mean 'loop'?)",
        "a.raw": "a.raw: 0 bytes without a header, of unknown height and width; give them in a camera.json ...",
        "a.txt": "a.txt: not a recording; expected a folder with a 16-bit PNG, ...: realsense or realsense:SERIAL; "
        "of other formats write the depth with Python: numpy.savez('take.npz', depth=array), (frames, height, width)",
    },
)
def test_missing_and_unknown_files_are_rejected(
    given: str, rejected: Any, asked: list[Any]
) -> None:
    """The error is raised before any reader is called."""
    Path("a.txt").touch()
    Path("a.raw").touch()
    Path("loop").symlink_to("loop")
    with rejected:
        open_recording(given)
    assert not asked


def converted(source: Path | str, said: str, status: int = 0) -> str:
    """Run the command in the error for a source, as a shell does; return what it
    prints as an error.
    """
    with pytest.raises(DataError, match=said) as raised:
        open_recording(source)
    program, *words = shlex.split(str(raised.value).partition("; this converts: ")[2])
    assert program == "python"
    return run_python(*words, cwd=Path(), status=status).err


def write_video(
    path: Path, milliseconds: Sequence[int], titles: Sequence[str] = ("",), **tags: str
) -> np.ndarray:
    """Write a video with a stream for each title: colours for COLOR, else 16-bit values 1000,
    1001 ... (first DEPTH).

    Return the depth, (frames, height, width).
    """
    av = pytest.importorskip("av", reason="PyAV is missing: pip install av")
    path.parent.mkdir(exist_ok=True)
    with av.open(str(path), "w", format="matroska") as video:
        video.metadata.update(tags)
        streams = []
        for title in titles:
            is_colour = title == "COLOR"
            stream = video.add_stream("mjpeg" if is_colour else "ffv1", rate=30)
            stream.width = 64
            stream.height = 48
            stream.pix_fmt = "yuvj420p" if is_colour else "gray16le"
            stream.codec_context.time_base = Fraction(1, 1000)
            stream.metadata["title"] = title
            streams.append(stream)
        for number, millisecond in enumerate(milliseconds):
            frames = {
                "COLOR": (np.full((48, 64), 90, np.uint8), "gray"),
                "IR": (hand_sized(distance=3000 + number), "gray16le"),
            }
            depth = (hand_sized(distance=1000 + number), "gray16le")
            for title, stream in zip(titles, streams):
                values, kind = frames.get(title, depth)
                frame = av.VideoFrame.from_ndarray(values, format=kind)
                frame = frame.reformat(format=stream.pix_fmt)
                frame.pts = millisecond
                frame.time_base = Fraction(1, 1000)
                video.mux(stream.encode(frame))
        for stream in streams:
            video.mux(stream.encode(None))
    return np.array([hand_sized(distance=1000 + number) for number in range(len(milliseconds))])


@pytest.mark.parametrize(
    ("titles", "name"),
    [
        (("",), "take.mkv"),
        (
            ("COLOR", "DEPTH", "IR"),
            "sub/it's a take (2).mkv",
        ),  # the order of Azure Kinect's recorder
        (("COLOR", "IR", "DEPTH"), "take.mkv"),
        (("COLOR", ""), "take.mkv"),
    ],
)
def test_videos_are_converted(titles: Sequence[str], name: str) -> None:
    """The stream of depth, every value, the times to 1 ms, and the camera in a tag, as
    tools/record.py once wrote.
    """
    depth = write_video(Path(name), (0, 33, 100), titles, CAMERA=camera_file.to_text(GIVEN))
    converted(name, "a video, ")
    with open_recording("frames") as recording:
        assert (recording.camera, recording.unit_mm) == (GIVEN.camera, GIVEN.unit_mm)
        assert times_of(recording) == pytest.approx([0, 0.033, 0.1])
        np.testing.assert_array_equal([frame.depth for frame in recording], depth / np.float32(2))


def test_a_video_of_colours_is_not_converted() -> None:
    write_video(Path("take.mkv"), (0, 33), ("COLOR",))
    assert converted("take.mkv", "a video, ", status=1) == "no stream of 16-bit grey values\n"
    assert not Path("frames").exists()


@pytest.mark.parametrize("name", ["take.h5", "sub/a take.hdf5"])
def test_hdf5_is_converted(name: str) -> None:
    Path(name).parent.mkdir(exist_ok=True)
    with h5py.File(name, "w") as file:
        file["depth"], file["timestamps_ms"] = hand_sized()[None], [5]
        file.attrs.update(fx=60.0, fy=61.0, cx=31.5, cy=23.5)
    converted(name, "HDF5; ")
    assert open_recording("frames.npz").camera.fy == 61


@pytest.mark.parametrize("form", ["camera0/{}/image", "camera0/{}/frames_{}", "depth_camera/{0}"])
def test_hdf5_with_groups_is_converted(form: str) -> None:
    """Of groups with depth, infrared and colours: the depth with its own times and camera."""
    with h5py.File("take.h5", "w") as file:
        for number, kind in enumerate(("colour", "depth", "infrared")):
            name = form.format(kind, kind)
            file[name] = [hand_sized(distance=1000 * number + i) for i in range(3)]
            owner = file[name].parent if kind in name.rpartition("/")[0] else file[name]
            owner.attrs.update(fx=60.0 + number, fy=61.0 + number, cx=31.5, cy=23.5)
        file[f"{form.partition('/')[0]}/timestamps_ms"] = [5, 15, 25]
    converted("take.h5", "^take.h5: HDF5; ")
    recording = open_recording("frames.npz")
    assert (recording.camera.fx, recording.camera.fy) == (61, 62)
    frames = list(recording)
    assert times_of(frames) == pytest.approx([0, 0.01, 0.02])
    assert middles(frames) == [1000, 1001, 1002]
    assert "exists" in converted("take.h5", "HDF5; ", status=1)  # nothing is replaced


def test_two_depth_cameras_of_an_hdf5_file() -> None:
    """The error names both instead of one being chosen."""
    with h5py.File("take.h5", "w") as file:
        for camera in ("left", "right"):
            file.create_group(camera)["depth"] = hand_sized()[None]
    converted("take.h5", "HDF5; ")
    with pytest.raises(
        DataError, match=r"holds left\.depth .*, right\.depth .*; expected an array depth"
    ):
        open_recording("frames.npz", GIVEN)


def test_pgm_is_converted() -> None:
    """Every file of the folder under its name, so that order, times and kinds are
    those of the names.
    """
    for number in range(12):
        put(Path(f"a take/d-{number}.pgm"), hand_sized(distance=1000 + number))
        put(Path(f"a take/ir-{number}.pgm"), hand_sized(distance=3000))
    converted("a take", r"holds no depth frames .*; a take/d-0\.pgm: PGM; ")
    with pytest.raises(DataError, match="holds 2 sequences"):
        open_recording("frames", GIVEN)
    frames = open_recording("frames/d-*.png", GIVEN)
    assert middles(frames) == [500 + number / 2 for number in range(12)]


def test_pfm_is_converted() -> None:
    """In metres, as data sets of stereo cameras have it: the rows are from the bottom up."""
    Path("take").mkdir()
    depth = (hand_sized() / 1000).astype("<f4")
    Path("take/1.pfm").write_bytes(b"Pf\n64 48\n-1.0\n" + depth[::-1].tobytes())
    converted("take/1.pfm", "PFM; ")
    (frame,) = open_recording("frames", replace(GIVEN, unit_mm=1000.0))
    np.testing.assert_allclose(frame.depth, hand_sized(), atol=0.01)


def test_an_archive_is_converted(folder: Path) -> None:
    shutil.make_archive("take", "zip", folder)
    converted("take.zip", "an archive; ")
    assert middles(open_recording("frames", GIVEN)) == [500.5, 501, 502]


@pytest.mark.parametrize("is_hdf5", [False, True])
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0)])
def test_matlab_is_converted(is_hdf5: bool, axes: tuple[int, int, int]) -> None:
    """Of both forms of files. Axes are those in MATLAB, usually with the frames as the last one."""
    depth = np.array([hand_sized(distance=1000 + i) for i in range(3)])
    values = {"d_depth": depth.transpose(axes), "timestamps_ms": np.array([[5.0, 15.0, 25.0]])}
    if is_hdf5:
        with h5py.File("take.mat", "w") as file:
            file.update({name: array.T for name, array in values.items()})
            file.create_group("#refs#")
    else:
        scipy.io.savemat("take.mat", values)
    converted("take.mat", "MATLAB; ")
    if axes != (0, 1, 2):
        with pytest.raises(DataError, match=r"\(48, 64, 3\).*: np.moveaxis\(array, 2, 0\)"):
            open_recording("frames.npz", GIVEN)
        return
    frames = list(open_recording("frames.npz", GIVEN))
    assert times_of(frames) == pytest.approx([0, 0.01, 0.02])
    assert middles(frames) == [500, 500.5, 501]


def test_a_folder_with_a_file_to_convert() -> None:
    Path("take").mkdir()
    with h5py.File("take/a.h5", "w") as file:
        file.create_group("camera0")["depth"] = hand_sized()[None]
    converted("take", r"take: holds no depth frames .*; found a\.h5; take/a\.h5: HDF5; ")
    assert open_recording("frames.npz", GIVEN).count == 1
