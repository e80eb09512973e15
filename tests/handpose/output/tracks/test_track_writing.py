"""handpose/output/tracks/writing.py: after any error, a file is complete or the old one"""

from __future__ import annotations

import errno
import io
from pathlib import Path
from typing import Any

import pytest

from handpose.output.tracks.json_file import read_track
from handpose.output.tracks.writing import TrackWriter, open_writer
from layers.hand.skeleton import load
from tests.support.made_tracks import any_track, header_of

HAND = header_of(load())
FULL = OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("name", ["a.json", "b.JSONL", "c.csv"])
def test_the_suffix_selects_the_format(tmp_path: Path, name: str) -> None:
    frames = any_track(HAND, 1)
    with open_writer(tmp_path / name, HAND) as writer:
        for frame in frames:
            writer.write(frame)
    assert list(tmp_path.iterdir()) == [tmp_path / name]
    if "json" in name.lower():
        assert len(read_track(tmp_path / name).frames) == len(frames)


def test_standard_output(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """JSON lines; one that is closed, as by >&- in a shell, is an error."""
    with open_writer("-", HAND) as writer:
        writer.write(any_track(HAND, 1)[0])
    assert capsys.readouterr().out.count("\n") == 2
    monkeypatch.setattr("sys.stdout", None)
    with pytest.raises(OSError, match="is closed: 'standard output'"), open_writer("-", HAND):
        pytest.fail("began all the same")


def pieces(path: Path, **options: Any) -> Any:
    """A writer of frames that are bytes, after ``<``."""
    return TrackWriter(path, lambda frame: frame, b"<", **options)


@pytest.mark.parametrize(("end", "content"), [(None, b"<a,b>"), (b"!", b"<a,b!")])
def test_frames_one_after_the_other(tmp_path: Path, end: bytes | None, content: bytes) -> None:
    """The file appears under its name only at the end, which may be another than after
    an interruption.
    """
    path = tmp_path / "a.txt"
    with pieces(path, between=b",", tail=b">", end=end) as file:
        for piece in (b"a", b"b"):
            file.write(piece)
        assert not path.exists()
    assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


class Stream:
    """A stream on a disk that fails halfway through the frame "wrong"."""

    def __init__(self, stream: io.FileIO, error: BaseException) -> None:
        self._stream, self._error = stream, error

    def write(self, content: bytes) -> int:
        if content.startswith(b"wrong"):
            self._stream.write(content[:3])
            raise self._error
        return self._stream.write(content)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


@pytest.mark.parametrize("shown", [False, True])
@pytest.mark.parametrize("count", [0, 1])
@pytest.mark.parametrize("error", [KeyboardInterrupt(), FULL], ids=["interrupt", "disk"])
def test_a_partly_written_frame_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, count: int, shown: bool
) -> None:
    """From a shown file it is removed at once. Without a complete frame the old file stays. The
    error names the file.
    """
    path = tmp_path / "a.txt"
    content = b"<a>" if count else b"old"
    path.write_bytes(b"old")
    with pytest.raises(type(error)) as caught, pieces(path, tail=b">", shown=shown) as file:
        for _ in range(count):
            file.write(b"a")
        monkeypatch.setattr(file, "_stream", Stream(file._stream, error))
        try:
            file.write(b"wrong")
        finally:
            if isinstance(error, OSError):
                assert path.read_bytes() == (content.removesuffix(b">") if shown else b"old")
    assert path.read_bytes() == content
    assert getattr(caught.value, "filename", str(path)) == str(path)
    assert list(tmp_path.iterdir()) == [path]


def test_a_shown_file_grows_from_its_first_frame_on(here: Path) -> None:
    """It replaces an old file, or a link but not its target, with its first frame."""
    path, target = Path("a.txt"), Path("target.txt")
    target.write_text("old")
    path.symlink_to(target)
    with pieces(path, shown=True) as file:
        assert path.read_text() == "old"
        file.write(b"a")
        assert path.read_bytes() == b"<a" and not path.is_symlink()
        file.write(b"b")
        assert path.read_bytes() == b"<ab"
    assert path.read_bytes() == b"<ab" and target.read_text() == "old"
    assert len(list(here.iterdir())) == 2


@pytest.mark.parametrize("name", ["folder", "none/a.txt"])
def test_a_path_that_cannot_be_written_is_rejected_at_once(here: Path, name: str) -> None:
    Path("folder").mkdir()
    with pytest.raises(OSError) as caught, pieces(Path(name)):
        pytest.fail("began all the same")
    assert caught.value.filename == str(Path(name))
