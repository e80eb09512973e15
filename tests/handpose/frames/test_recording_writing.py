"""handpose/frames/writing.py: recordings are restored to the last value and microsecond."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handpose.frames.cameras import Camera
from handpose.frames.formats import open_recording
from handpose.frames.recording import DepthFrame
from handpose.frames.writing import RecordingWriter
from netlib.errors import DataError, NetlibError
from tests.support.bad_input import bad_inputs

SMALL = Camera("own", 5.0, 6.0, 2.0, 1.5, 4, 3)


def frames(count: int = 3, start: float = 0.0) -> list[DepthFrame]:
    """Different frames, 1/30 s apart."""
    return [
        DepthFrame(i, start + i / 30, np.full((3, 4), 100.0 + i, np.float32)) for i in range(count)
    ]


def write(path: Path, taken: list[DepthFrame], unit_mm: float = 0.5) -> None:
    """Write a recording of some frames."""
    with RecordingWriter(path, SMALL, unit_mm, 30.0) as writer:
        for frame in taken:
            writer.write(frame)
    assert writer.count == len(taken)


@pytest.mark.parametrize("name", ["take", "take.1", "take.npz"])
def test_a_recording_comes_back(here: Path, name: str) -> None:
    """Camera, unit, rate and times are restored, relative to the first frame; no
    other file is left.
    """
    write(Path("new", name), frames(start=7.5))
    recording = open_recording(Path("new", name))
    assert (recording.camera, recording.unit_mm, recording.rate, recording.count) == (
        SMALL,
        0.5,
        30,
        3,
    )
    assert [frame.time for frame in recording] == pytest.approx([0, 1 / 30, 2 / 30], abs=1e-6)
    assert [float(frame.depth.mean()) for frame in recording] == [100, 101, 102]
    assert [path.name for path in Path("new").iterdir()] == [name]


@settings(max_examples=25, deadline=None)
@given(
    values=st.lists(
        st.lists(st.integers(0, 65535), min_size=12, max_size=12), min_size=1, max_size=3
    ),
    gaps=st.lists(st.integers(1, 10**8), min_size=3, max_size=3),
    unit_mm=st.sampled_from([0.1, 0.125, 1 / 3, 1.0]),
)
@pytest.mark.parametrize("name", ["take", "take.npz"])
def test_written_depths_and_times_are_restored_exactly(
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    values: list[list[int]],
    gaps: list[int],
    unit_mm: float,
) -> None:
    path = tmp_path_factory.mktemp("any") / name
    stored = np.array(values, np.uint16).reshape(-1, 3, 4)
    times = [sum(gaps[:i]) / 10**6 for i in range(len(stored))]
    depths = stored.astype(np.float32) * np.float32(unit_mm)
    write(
        path,
        [DepthFrame(i, time, depth) for i, (time, depth) in enumerate(zip(times, depths))],
        unit_mm,
    )
    found = list(open_recording(path))
    np.testing.assert_array_equal([frame.depth for frame in found], depths)
    assert [frame.time for frame in found] == times


@pytest.mark.parametrize("name", ["take", "take.npz"])
@bad_inputs(
    DataError,
    {
        "too far": (
            DepthFrame(9, 1.0, np.full((3, 4), 70000, np.float32)),
            "...: frame 9: depth from 70000 to 70000 mm does not fit into 16 bits of 1 mm; expected 0 to ...",
        ),
        "too early": (
            DepthFrame(9, 1 / 30, np.ones((3, 4), np.float32)),
            "...: frame 9: at 0.033333 s, which is not after the frame before",
        ),
        "no time": (
            DepthFrame(9, np.nan, np.ones((3, 4), np.float32)),
            "...: frame 9: at nan s, which is not after the frame before",
        ),
        "another size": (
            DepthFrame(9, 1.0, np.ones((4, 3), np.float32)),
            "...: frame 9 has the shape (4, 3), expected (3, 4)",
        ),
    },
)
def test_frames_that_cannot_be_stored_are_rejected(
    here: Path, name: str, given: DepthFrame, rejected: Any
) -> None:
    with rejected, RecordingWriter(name, SMALL, 1.0) as writer:
        for one in (*frames(2), given):
            writer.write(one)
    assert writer.count == 2
    assert len(list(open_recording(Path(name)))) == 2


@bad_inputs(
    NetlibError,
    {
        **{
            name: f"{name}: is there already; name a new one or remove it"
            for name in ("take", "take.npz", "file")
        },
        **{
            f"file/{name}": "...file: is a file; expected a folder" for name in ("take", "take.npz")
        },
        **{
            f"new.{end}": f"new.{end}: cannot write .{end}; expected a folder or FILE.npz"
            for end in ("npy", "mkv", "h5", "bag", "png")
        },
    },
)
def test_existing_and_impossible_places_are_rejected(
    here: Path, monkeypatch: pytest.MonkeyPatch, given: str, rejected: Any
) -> None:
    """Existing files are never replaced."""
    Path("file").touch()
    for name in ("take", "take.npz"):
        write(Path(name), frames(3))
    before = {path: path.is_file() and path.read_bytes() for path in Path().rglob("*")}
    with rejected:
        write(Path(given), frames(1))
    assert {path: path.is_file() and path.read_bytes() for path in Path().rglob("*")} == before


def test_a_folder_that_another_program_fills_meanwhile(here: Path) -> None:
    first, second = (RecordingWriter(Path("take"), SMALL, 1.0) for _ in range(2))
    with first, pytest.raises(NetlibError, match="take: is there already"), second:
        first.write(frames(1)[0])
        second.write(frames(1)[0])
    assert len(list(open_recording(Path("take")))) == 1


@pytest.mark.parametrize("name", ["take", "take.npz"])
def test_without_frames_there_is_no_recording(here: Path, name: str) -> None:
    write(Path(name), [])
    assert list(here.iterdir()) == []


def test_an_empty_folder_is_filled(here: Path) -> None:
    write(here, frames(3))
    assert open_recording(here).count == 3
