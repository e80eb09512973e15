"""handpose/output/drawing/video_file.py"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.output.drawing.strokes import Image
from handpose.output.drawing.video_file import TICKS_PER_S, VideoFile
from netlib.errors import DataError, NetlibError
from tests.support.bad_input import bad_inputs

av = pytest.importorskip("av", reason="needs PyAV")
TIMES = [5.0, 5.033, 5.066, 6.5, 6.501, 6.6]  # with a gap


def picture(n: int, height: int = 64, width: int = 96) -> Image:
    """A grey picture, with another grey for each number."""
    return np.full((height, width, 3), 40 * n, np.uint8)


def write(path: Path, times: list[float] = TIMES) -> None:
    with VideoFile(path) as video:
        for n, time in enumerate(times):
            video.write(picture(n), time)


def read(path: Path) -> list[tuple[float, int]]:
    """The time and the grey of every frame."""
    with av.open(str(path)) as file:
        return [
            (frame.time, int(frame.to_ndarray(format="gray")[9, 9]))
            for frame in file.decode(video=0)
        ]


def test_every_picture_at_its_time_as_browsers_play_it(here: Path) -> None:
    """The first time is 0, gaps are kept, and no picture is omitted or changed; the last one
    lasts one period.

    The file is H.264 in yuv420p, with the index first.
    """
    write(Path("a.mp4"))
    frames = read(Path("a.mp4"))
    assert_allclose([time for time, _ in frames], np.subtract(TIMES, 5.0), atol=1 / TICKS_PER_S)
    assert_allclose([grey for _, grey in frames], 40 * np.arange(6), atol=4)
    content = Path("a.mp4").read_bytes()
    assert 0 < content.index(b"moov") < content.index(b"mdat")
    with av.open(str(Path("a.mp4"))) as file:
        coder = file.streams.video[0].codec_context
        assert (coder.name, coder.pix_fmt, coder.width, coder.height) == ("h264", "yuv420p", 96, 64)
        # limited range, 16 to 235, to which the pictures are converted
        assert coder.color_range == 1
        assert file.duration / 1e6 == pytest.approx(1.6 + 1 / 30, abs=0.001)


def test_odd_sizes_are_padded_and_extreme_rates_clipped(here: Path) -> None:
    """The picture gets a row and a column. The rate affects only the last picture's duration."""
    for rate in (1e-300, 1e300):
        with VideoFile(Path("a.mp4"), rate) as video:
            video.write(picture(3, 63, 95), 0.0)
            video.write(picture(3, 63, 95), 0.5)
        with av.open(str(Path("a.mp4"))) as file:
            images = [frame.to_ndarray(format="gray") for frame in file.decode(video=0)]
        assert [image.shape for image in images] == [(64, 96)] * 2
        assert np.ptp(np.array(images, int)) < 5


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_pictures_written_before_a_stop_are_kept(tmp_path: Path, stop: type[BaseException]) -> None:
    """After Ctrl-C or an error the file has all pictures so far, replaces an older file, and is the
    only one left.
    """
    path = tmp_path / "a.mp4"
    path.write_bytes(b"old")
    with pytest.raises(stop), VideoFile(path) as video:
        for n in range(4):
            video.write(picture(n), n / 30)
        assert path.read_bytes() == b"old"
        raise stop
    assert len(read(path)) == 4
    assert list(tmp_path.iterdir()) == [path]


def test_without_a_picture_there_is_no_file(here: Path) -> None:
    Path("a.mp4").write_bytes(b"old")
    with VideoFile(Path("a.mp4")):
        pass
    with pytest.raises(ValueError), VideoFile(Path("b.mp4")):
        raise ValueError
    assert [path.read_bytes() for path in here.iterdir()] == [b"old"]


def test_errors_of_writing_name_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk, a missing folder and a folder of that name raise an error; no file is left."""

    def full(video: VideoFile, frame: object) -> None:
        raise av.error.FFmpegError(28, "No space left on device", "something.tmp")

    with monkeypatch.context() as patch:
        patch.setattr(VideoFile, "_mux", full)
        with pytest.raises(OSError, match="No space left") as error:
            write(tmp_path / "a.mp4")
    assert error.value.filename == str(tmp_path / "a.mp4") and list(tmp_path.iterdir()) == []
    with pytest.raises(FileNotFoundError, match=r"none/a\.mp4'$"):
        write(tmp_path / "none" / "a.mp4")
    (tmp_path / "folder.mp4").mkdir()
    with pytest.raises(IsADirectoryError):
        write(tmp_path / "folder.mp4")
    assert list(tmp_path.iterdir()) == [tmp_path / "folder.mp4"]


LATER = "expected a later one, by 1/60000 s at least and 1e+08 s at most"


@bad_inputs(
    DataError,
    {
        f"at {time} s": (time, f"...a.mp4: a picture at {time:.6g} s after one at 1 s; {LATER}")
        for time in (1.0, 1.000001, 1e300)
    },
)
def test_times_must_ascend(here: Path, given: float, rejected: Any) -> None:
    with VideoFile(Path("a.mp4")) as video:
        video.write(picture(1), 1.0)
        with rejected:
            video.write(picture(1), given)
    assert len(read(Path("a.mp4"))) == 1


@bad_inputs(
    NetlibError,
    {
        "a.avi": "...a.avi: a video is written as .mp4; expected such a name",
        "a.mp4": "PyAV is missing: pip install av",
        "b.mp4": "...b.mp4: PyAV has no encoder of H.264 here; expected libx264 or libopenh264, ...",
    },
)
def test_unsupported_formats_and_missing_encoders_are_rejected(
    here: Path, monkeypatch: pytest.MonkeyPatch, given: str, rejected: Any
) -> None:
    """Another suffix, a missing PyAV, and one without an encoder of H.264 raise errors."""
    monkeypatch.setattr(av, "codecs_available", {"mpeg4", "png"})
    if given == "a.mp4":
        monkeypatch.setitem(sys.modules, "av", None)
    with rejected:
        VideoFile(Path(given))
