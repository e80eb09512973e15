"""Errors of tools/track.py: one line, and no file is changed."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.running import contents, run_tool
from tests.tools.conftest import mistakes_of

CAMERA = '{"fx": 60, "fy": 60, "u0": 31.5, "v0": 23.5, "unit_mm": 1}'


@pytest.fixture(autouse=True)
def frames(here: Path) -> Path:
    """Three frames without a hand, in a folder with a camera.json."""
    Path("frames").mkdir()
    for i in range(3):
        cv2.imwrite(f"frames/{i}.png", np.full((48, 64), 900 + i, np.uint16))
    Path("frames/camera.json").write_text(CAMERA)
    return Path("frames")


@mistakes_of("track")
def test_unsuitable_outputs_are_rejected_before_tracking(argv: str, message: str) -> None:
    """They are inputs, would be inputs of the next run, or cannot be written."""
    np.save("take.npy", np.full((2, 48, 64), 900, np.uint16))
    for name in ("own.json", "take.camera.json"):
        Path(name).write_text(CAMERA)
    Path("link.jsonl").symlink_to("frames/camera.json")
    Path("folder.mp4").mkdir()
    before = contents()
    lines = run_tool(f"track {argv}", status=1).err.splitlines()
    (line,) = [line for line in lines if not line.startswith("warning")]
    assert line.startswith(message)
    assert contents() == before


def test_the_default_names_do_not_replace_frames(
    frames: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(frames)
    before = contents()
    for source in (".", "*.png", "1.png"):
        done = run_tool(f"track {source}", status=1)
        assert done.err.splitlines()[-1].startswith(
            ("frames.png: is in the folder", "1.png: is read")
        )
    assert contents() == before


@pytest.mark.parametrize("name", ["frames.json", "frames.png"])
def test_the_default_names_replace_nothing(name: str) -> None:
    """An existing file is not replaced by a default name; the error says how to name it."""
    Path(name).write_text("mine")
    before = contents()
    assert run_tool("track frames", status=1).err == (
        f"{name}: exists already; to replace it or to write elsewhere, name the outputs, as in "
        "--json frames.json --sheet frames.png\n"
    )
    assert contents() == before


def test_a_hand_in_another_unit() -> None:
    """If no hand is found, the summary and --look repeat what may be wrong: here the unit."""
    image = np.full((48, 64), 9000, np.uint16)
    image[18:28, 26:38] = 2250  # 450 mm in units of 0.2 mm
    np.save("fifths.npy", np.stack([image + i for i in range(2)]))
    command = "track fifths.npy --camera 60,60,31.5,23.5 --hands 1"
    done = run_tool(f"{command} --json a.json")
    assert "--unit 0.2 0.45 m away and 90 mm wide" in done.err
    assert "not plausible for a hand" in done.err
    (line,) = [line for line in done.out.splitlines() if line.startswith("no hand was found")]
    assert "the unit, 1 mm, may be wrong" in line
    assert "--unit 0.2 0.45 m away" in line
    (*_, last) = run_tool(f"{command} --look a.png", status=1).err.splitlines()
    assert (
        "no hand in the first 2 frames; a.png shows the first one; the unit, 1 mm, may be wrong"
        in last
    )
