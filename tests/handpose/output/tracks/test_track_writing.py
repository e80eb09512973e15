"""handpose/output/tracks/writing.py"""

from __future__ import annotations

from pathlib import Path

import pytest

from handpose.output.tracks.json_file import read_track
from handpose.output.tracks.writing import open_writer
from layers.hand.skeleton import load
from tests.support.made_tracks import any_track, header_of

HAND = header_of(load())
NAMES = {"a.json": ["a.json"], "b.JSONL": ["b.JSONL"], "c.csv": ["c.csv"]}


@pytest.mark.parametrize("name", NAMES)
def test_by_the_ending(tmp_path: Path, name: str) -> None:
    """The suffix selects the writer, which returns the files that it wrote."""
    frames = any_track(HAND, 1)
    with open_writer(tmp_path / name, HAND) as writer:
        for frame in frames:
            writer.write(frame)
    assert sorted(writer.files) == sorted(tmp_path.iterdir()) == [tmp_path / file for file in NAMES[name]]
    if "json" in name.lower():
        assert len(read_track(tmp_path / name).frames) == len(frames)


def test_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    """The name - stands for standard output."""
    with open_writer("-", HAND) as writer:
        writer.write(any_track(HAND, 1)[0])
    assert capsys.readouterr().out.count("\n") == 2
    assert writer.files == []
