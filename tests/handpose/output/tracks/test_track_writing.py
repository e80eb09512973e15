"""handpose/output/tracks/writing.py: after any error, a file is complete or the old one"""

from __future__ import annotations

import errno
import io
from pathlib import Path

import pytest

from handpose.output.tracks.json_file import read_track
from handpose.output.tracks.writing import GrowingFile, open_writer
from layers.hand.skeleton import load
from tests.support.made_tracks import any_track, header_of

HAND = header_of(load())
NAMES = ("a.json", "b.JSONL", "c.csv")


@pytest.mark.parametrize("name", NAMES)
def test_by_the_ending(tmp_path: Path, name: str) -> None:
    frames = any_track(HAND, 1)
    with open_writer(tmp_path / name, HAND) as writer:
        for frame in frames:
            writer.write(frame)
    assert list(tmp_path.iterdir()) == [tmp_path / name]
    if "json" in name.lower():
        assert len(read_track(tmp_path / name).frames) == len(frames)


def test_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    with open_writer("-", HAND) as writer:
        writer.write(any_track(HAND, 1)[0])
    assert capsys.readouterr().out.count("\n") == 2


def test_pieces_one_after_the_other(tmp_path: Path) -> None:
    """The file appears under its name only at the end, and no other file is left."""
    path = tmp_path / "a.txt"
    with GrowingFile(path, b"<", b">") as file:
        for piece in (b"a", b"b"):
            file.append(piece)
        assert not path.exists()
    assert path.read_bytes() == b"<ab>"
    assert list(tmp_path.iterdir()) == [path]


def test_another_end(tmp_path: Path) -> None:
    """A complete file has another end than one after an interruption."""
    with GrowingFile(tmp_path / "a.txt", b"<", b" cut>", b">") as file:
        file.append(b"a")
    assert (tmp_path / "a.txt").read_bytes() == b"<a>"


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_a_piece_that_was_not_written_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    """A partly written piece is removed, and a disk error names the file."""
    path = tmp_path / "a.txt"
    file = GrowingFile(path, b"<", b">")
    with pytest.raises(type(error)) as caught, file:
        file.append(b"a")
        monkeypatch.setattr(file, "_stream", Stream(file._stream, error))
        file.append(b"wrong")
    assert path.read_bytes() == b"<a>"
    assert getattr(caught.value, "filename", str(path)) == str(path)


class Stream:
    """A stream on a disk that fails halfway through the piece "wrong"."""

    def __init__(self, stream: io.FileIO, error: BaseException) -> None:
        self._stream, self._error = stream, error

    def write(self, content: bytes) -> int:
        if content.startswith(b"wrong"):
            self._stream.write(content[:3])
            raise self._error
        return self._stream.write(content)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


def test_a_file_that_is_shown(tmp_path: Path) -> None:
    """It replaces an old file, or a link but not its target, with its first piece, and grows from then on."""
    path, target = tmp_path / "a.txt", tmp_path / "target.txt"
    target.write_text("old")
    path.symlink_to(target)
    with GrowingFile(path, b"head\n", shown=True) as file:
        assert path.read_text() == "old"
        file.append(b"a\n")
        assert path.read_bytes() == b"head\na\n" and not path.is_symlink()
        file.append(b"b\n")
    assert path.read_bytes() == b"head\na\nb\n" and target.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 2


def test_a_shown_piece_that_was_not_written_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A partly written piece is removed at once; without a whole one, the old file stays."""
    path, error = tmp_path / "a.txt", OSError(errno.ENOSPC, "No space left on device")
    for pieces in ((), (b"a\n",)):
        path.write_text("old")
        with pytest.raises(OSError), GrowingFile(path, b"head\n", shown=True) as file:
            for piece in pieces:
                file.append(piece)
            monkeypatch.setattr(file, "_stream", Stream(file._stream, error))
            try:
                file.append(b"wrong\n")
            finally:
                assert path.read_bytes() == (b"head\na\n" if pieces else b"old")
        assert path.read_bytes() == (b"head\na\n" if pieces else b"old")


def test_before_the_first_piece_the_old_file_stays(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt), GrowingFile(tmp_path / "a.txt", b"<", b">"):
        raise KeyboardInterrupt
    assert (tmp_path / "a.txt").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("name", ["folder", "none/a.txt"])
def test_where_no_file_can_be(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError) as caught, GrowingFile(tmp_path / name):
        pytest.fail("began all the same")
    assert caught.value.filename == str(tmp_path / name)
