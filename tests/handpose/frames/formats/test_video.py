"""Depth in lossless video: values are restored, lossy formats raise errors, truncation is reported."""

from __future__ import annotations

import contextlib
import resource
import signal
import sys
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given as over
from hypothesis import settings
from hypothesis import strategies as st

from handpose.frames.cameras import Camera
from handpose.frames.formats.video import open_video
from handpose.frames.formats.video_writer import VideoWriter
from handpose.frames.lens import Lens
from handpose.frames.recording import CameraInfo, DepthFrame
from netlib.errors import DataError, NetlibError
from tests.support.bad_input import bad_inputs

av = pytest.importorskip("av", reason="PyAV is missing: pip install av")

CAMERA = Camera("own", 61.25, 60.5, 31.3, 23.7, 64, 48)
GIVEN = CameraInfo(camera=Camera("own", 60, 60, 32, 24, 0, 0), origin="--camera")


def frames(count: int = 6, unit_mm: float = 0.125) -> list[DepthFrame]:
    """Random depths in whole units, at uneven times of whole milliseconds."""
    rng = np.random.default_rng(0)
    raw = rng.integers(0, 1 << 16, (count, 48, 64)).astype(np.uint16)
    return [DepthFrame(i, i * 0.033 + i * i * 0.001, r * np.float32(unit_mm)) for i, r in enumerate(raw)]


def write(path: Path, written: list[DepthFrame], unit_mm: float = 0.125, rate: float | None = 30.0) -> Path:
    with VideoWriter(path, CAMERA, unit_mm, rate) as video:
        for frame in written:
            video.write(frame)
    return path


@contextlib.contextmanager
def room_for(size: int) -> Iterator[None]:
    """Within the block no file of this process can grow beyond a size, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def write_other(path: Path, codec: str, pixels: str, count: int = 3, **options: str) -> Path:
    """A video as written by other programs."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=10, options=options)
        stream.width, stream.height, stream.pix_fmt = 64, 48, pixels
        for i in range(count):
            picture = av.VideoFrame(64, 48, "gray16le")
            picture.planes[0].update(np.full((48, picture.planes[0].line_size // 2), 1600 * (i + 1), "<u2").tobytes())
            picture.pts, picture.time_base = i, Fraction(1, 10)
            container.mux(stream.encode(picture.reformat(format=pixels)))
        container.mux(stream.encode(None))
    return path


def test_every_value_returns(tmp_path: Path) -> None:
    """Values, camera, unit, rate and times are restored, on a second iteration as well."""
    written = frames()
    with open_video(write(tmp_path / "a.mkv", written), CameraInfo()) as recording:
        assert (recording.camera, recording.unit_mm, recording.rate) == (CAMERA, 0.125, 30.0)
        for _ in range(2):
            read = list(recording)
            assert [f.number for f in read] == list(range(6))
            assert [f.time for f in read] == pytest.approx([f.time for f in written], abs=1e-9)
            assert all(np.array_equal(a.depth, b.depth) for a, b in zip(read, written))
            assert recording.cut == ""
            assert read[0].depth.dtype == np.float32


@settings(max_examples=25, deadline=None)
@over(
    st.lists(st.floats(0.001, 2.0), min_size=1, max_size=8),
    st.sampled_from([1.0, 0.125, 0.1, 0.25]),
    st.integers(0, 1 << 32),
)
def test_any_depth_at_any_time(
    tmp_path_factory: pytest.TempPathFactory, steps: list[float], unit: float, seed: int
) -> None:
    """Values are exact, and times are exact to half a millisecond."""
    rng = np.random.default_rng(seed)
    times = np.cumsum([0.0, *(step + 0.001 for step in steps)])
    raw = rng.integers(0, 1 << 16, (len(times), 48, 64)).astype(np.float32) * np.float32(unit)
    path = tmp_path_factory.mktemp("any") / "a.mkv"
    write(path, [DepthFrame(i, float(t), d) for i, (t, d) in enumerate(zip(times, raw))], unit, None)
    recording = open_video(path, CameraInfo())
    read = list(recording)
    assert np.abs(np.array([f.time for f in read]) - times).max() < 0.00051
    assert all(np.array_equal(f.depth, d) for f, d in zip(read, raw))
    assert (recording.rate, recording.cut) == (None, "")


@pytest.mark.parametrize("pixels", ["gray16le", "gray12le", "gray10le"])
def test_videos_of_other_programs(tmp_path: Path, pixels: str) -> None:
    """The camera must be given; values with fewer bits are not scaled."""
    path = write_other(tmp_path / "a.mkv", "ffv1", pixels)
    with pytest.raises(DataError, match="the camera of these frames is unknown"):
        open_video(path, CameraInfo())
    recording = open_video(path, GIVEN)
    shift = 16 - int(pixels[4:6])
    expected = [1600 * (i + 1) >> shift for i in range(3)]
    assert [f.depth[5, 5] for f in recording] == pytest.approx(expected, abs=1)  # FFmpeg rounds in its own way
    assert (recording.camera.width, recording.camera.height, recording.rate) == (64, 48, 10.0)


def test_camera_beside_the_file(tmp_path: Path) -> None:
    """A camera.json is used for a video without metadata."""
    path = write_other(tmp_path / "a.mkv", "ffv1", "gray16le")
    (tmp_path / "camera.json").write_text('{"fx": 50, "fy": 50, "u0": 32, "v0": 24, "unit_mm": 0.5}')
    recording = open_video(path, CameraInfo())
    assert (recording.camera.fx, recording.unit_mm) == (50, 0.5)
    assert next(iter(recording)).depth[0, 0] == 800


@bad_inputs(DataError, {
    f"{codec} {pixels}": f"...a.mkv: {codec} video {line}: depth does not survive that; expected FFV1 of 16 bits ..."
    for codec, pixels, line in (("ffv1", "gray", "of gray pixels, not 16-bit grey"),
                                ("ffv1", "bgr0", "of bgr0 pixels, not 16-bit grey"),
                                ("mjpeg", "yuvj420p", "(yuvj420p), which is lossy"),
                                ("mpeg4", "yuv420p", "(yuv420p), which is lossy"))
})
def test_what_loses_depth_is_refused(tmp_path: Path, given: str, rejected: Any) -> None:
    """8 bits, colours and lossy compression raise an error with the reason."""
    path = write_other(tmp_path / "a.mkv", *given.split())
    with rejected:
        open_video(path, GIVEN)


def test_the_lens_is_taken_away(tmp_path: Path) -> None:
    """The distortion of a given lens is removed from the frames."""
    path = write(tmp_path / "a.mkv", frames(1))
    bent = CameraInfo(CAMERA, Lens((0.3, 0.0, 0.0, 0.0)), 0.125, origin="--camera")
    plain, straight = (next(iter(open_video(path, given))).depth for given in (CameraInfo(), bent))
    assert plain[24, 31] == straight[24, 31]
    assert not np.array_equal(plain, straight)


@pytest.mark.parametrize("at", [0.35, 0.6, 0.85])
def test_a_cut_file(tmp_path: Path, at: float) -> None:
    """The complete frames before the cut are returned unchanged, and ``cut`` reports it."""
    written = frames(10)
    path = write(tmp_path / "a.mkv", written)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * at)])
    recording = open_video(path, CameraInfo())
    read = list(recording)
    assert 0 < len(read) < 10
    assert all(np.array_equal(a.depth, b.depth) for a, b in zip(read, written))
    assert recording.cut != ""


def test_a_file_cut_between_two_frames(tmp_path: Path) -> None:
    """The size in the header reveals a file truncated between two frames."""
    path = write(tmp_path / "a.mkv", frames(10))
    with av.open(str(path)) as container:
        ninth = [p.pos for p in container.demux(video=0) if p.size][8]
    path.write_bytes(path.read_bytes()[:ninth])
    recording = open_video(path, CameraInfo())
    assert len(list(recording)) == 8
    assert "the file ends at byte" in recording.cut


def test_a_writer_that_was_killed(tmp_path: Path) -> None:
    """All frames of a file without an end are read, and ``cut`` reports the interrupted writer."""
    path = write(tmp_path / "a.mkv", frames(10))
    content = bytearray(path.read_bytes())
    at = content.index(b"\x18\x53\x80\x67") + 4
    content[at : at + 8] = b"\x01" + b"\xff" * 7  # an unknown size
    path.write_bytes(content)
    recording = open_video(path, CameraInfo())
    assert len(list(recording)) == 10
    assert "its writer was interrupted" in recording.cut


def test_a_damaged_frame_is_no_frame(tmp_path: Path) -> None:
    """Reading ends at a damaged frame, which FFmpeg would fill with the previous one."""
    path = write(tmp_path / "a.mkv", frames(10))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    recording = open_video(path, CameraInfo())
    read = list(recording)
    assert all(np.array_equal(a.depth, b.depth) for a, b in zip(read, frames(10)))
    assert "frame 4" in recording.cut or "frame 3" in recording.cut


NO_VIDEO = "...a.mkv: no video in Matroska, AVI or MP4; expected FFV1 of 16 bits in Matroska (.mkv)"


@bad_inputs(DataError, {
    "empty": (b"", NO_VIDEO),
    "a text": (b"no video", NO_VIDEO),
    "a playlist": (b"#EXTM3U\nhttp://127.0.0.1/a.ts\n", NO_VIDEO),
    "a header alone": (b"\x1a\x45\xdf\xa3" + b"\0" * 99, "...a.mkv: cannot read the video: damaged or cut: ..."),
})
def test_what_is_no_video(tmp_path: Path, given: bytes, rejected: Any) -> None:
    """Invalid files raise an error; playlists of other files are not followed."""
    path = tmp_path / "a.mkv"
    path.write_bytes(given)
    with rejected:
        open_video(path, GIVEN)


class TestWriter:
    def test_an_exception_leaves_the_frames_so_far(self, tmp_path: Path) -> None:
        """After an exception the frames so far are a valid file, and no other file is left."""
        written = frames()

        def interrupted() -> None:
            with VideoWriter(tmp_path / "a.mkv", CAMERA, 0.125, 30) as video:
                for frame in written[:4]:
                    video.write(frame)
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            interrupted()
        recording = open_video(tmp_path / "a.mkv", CameraInfo())
        assert [np.array_equal(a.depth, b.depth) for a, b in zip(recording, written)] == [True] * 4
        assert recording.cut == ""
        assert [path.name for path in tmp_path.iterdir()] == ["a.mkv"]

    def test_without_frames_there_is_no_file(self, tmp_path: Path) -> None:
        write(tmp_path / "a.mkv", [])
        assert list(tmp_path.iterdir()) == []

    def test_the_old_file_stays_until_the_new_one_is_whole(self, tmp_path: Path) -> None:
        path = write(tmp_path / "a.mkv", frames(2))
        before = path.read_bytes()
        with VideoWriter(path, CAMERA, 0.125, 30) as video:
            video.write(frames()[0])
            assert path.read_bytes() == before
        assert path.read_bytes() != before

    @bad_inputs(DataError, {
        name: (change, f"...a.mkv: frame 1: {line}")
        for name, change, line in (
            *((f"{depth} mm", {"depth": np.full((48, 64), depth, np.float32)},
               f"depth from {depth} to {depth} mm does not fit into 16 bits of 0.125 mm; expected 0 to 8191.88, ...")
              for depth in (9000, -1, np.nan)),
            ("less than a tick", {"time": 0.0002}, "at 0.000200 s, less than 1 ms after the frame before; ..."),
        )
    })
    def test_what_cannot_be_written(self, tmp_path: Path, given: dict[str, object], rejected: Any) -> None:
        """An invalid frame raises an error, and the frames before it are kept."""
        first = frames(1)[0]
        with rejected:
            write(tmp_path / "a.mkv", [first, first._replace(number=1, **{"time": 0.1, **given})])
        assert len(list(open_video(tmp_path / "a.mkv", CameraInfo()))) == 1

    @pytest.mark.parametrize("failing_at", ["a frame", "the end"])
    def test_a_disk_that_fails(self, tmp_path: Path, failing_at: str) -> None:
        """If writing fails, an old file stays; without one, the frames written so far are left as a truncated file."""
        written = frames(60)
        size = write(tmp_path / "a.mkv", written[:40]).stat().st_size
        count = 60 if failing_at == "a frame" else 35  # less than five seconds
        path = tmp_path / "a.mkv"
        before = path.read_bytes()
        with pytest.raises(OSError, match=r"File too large: .*a\.mkv"), room_for(size // 2):
            write(path, written[:count])
        assert path.read_bytes() == before  # an old file stays
        path.unlink()
        with pytest.raises(OSError, match=r"File too large: .*a\.mkv"), room_for(size // 2):
            write(path, written[:count])
        recording = open_video(tmp_path / "a.mkv", CameraInfo())
        read = list(recording)
        assert recording.cut and 0 < len(read) < 35
        assert all(np.array_equal(a.depth, b.depth) for a, b in zip(read, written))
        assert [one.name for one in tmp_path.iterdir()] == ["a.mkv"]

    @pytest.mark.parametrize("room", [0, 1000, 5000])
    def test_a_disk_that_fails_before_the_first_frame(self, tmp_path: Path, room: int) -> None:
        """If writing fails before the first frame, the old file stays."""
        path = write(tmp_path / "a.mkv", frames(2))
        before = path.read_bytes()
        with pytest.raises(OSError, match=r"File too large: .*a\.mkv"), room_for(room):
            write(path, frames(60))
        assert path.read_bytes() == before
        assert [one.name for one in tmp_path.iterdir()] == ["a.mkv"]

    def test_where_nothing_can_be_written(self, tmp_path: Path) -> None:
        (tmp_path / "folder.mkv").mkdir()
        with pytest.raises(DataError, match="it is not a file"):
            write(tmp_path / "folder.mkv", frames(1))
        with pytest.raises(OSError, match=r"No such file or directory: '.*nowhere/a\.mkv'$"):
            write(tmp_path / "nowhere" / "a.mkv", frames(1))


def test_without_pyav(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The error names the command that installs PyAV."""
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(NetlibError, match=r"^PyAV is missing: pip install av"):
        open_video(tmp_path / "a.mkv", CameraInfo())
