"""tools/record.py: conversion of recordings, and the messages printed."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from handpose.frames.formats import open_recording
from tests.support.running import refusal, run_tool
from tests.tools.conftest import mistakes_of
from tools import record

CAMERA = "--camera 60,60,31.5,23.5"


@pytest.fixture
def frames(here: Path) -> Path:
    """Four frames of a hand 500 mm away."""
    for i in range(4):
        image = np.full((48, 64), 1000 + i, np.uint16)
        image[18:28, 26:38] = 500
        Path("frames").mkdir(exist_ok=True)
        cv2.imwrite(f"frames/{i}.png", image)
    return Path("frames")


def test_convert_and_replay(frames: Path) -> None:
    """Conversion from and to each format is lossless, assumptions are printed, and folders on
    the way are made.
    """
    out = run_tool(f"record frames {CAMERA} --out new/a").out
    assert "frames: 4 frames, 64 x 48 pixels, 30 frames/s\n" in out
    assert "a value of 1 is taken for 1 mm" in out
    assert "30 frames per second assumed" in out
    assert out.endswith("wrote new/a: 4 frames of 0.1 s, unit 1 mm\n")
    run_tool("record new/a --out other/b.npz")
    assert "assumed" not in run_tool("record other/b.npz --out c").out
    new, old = (
        {path.name: path.read_bytes() for path in Path(folder).iterdir()}
        for folder in ("new/a", "c")
    )
    assert new == old
    run_tool(f"record frames {CAMERA} --rate 10 --out part --seconds 0.2")
    assert open_recording("part").count == 2


def test_sources_in_metres_are_converted_to_millimetres(frames: Path) -> None:
    np.save("take.npy", np.full((2, 48, 64), 0.50025) + [[[0]], [[0.25]]])
    run_tool(f"record take.npy {CAMERA} --unit 1000 --out own.npz")
    recording = open_recording("own.npz")
    assert recording.unit_mm == 1
    assert next(iter(recording)).depth[0, 0] == 500


def test_a_doubtful_unit_and_damaged_frames_are_reported(frames: Path) -> None:
    Path("frames/2.png").write_bytes(b"")
    reported = run_tool(f"record frames {CAMERA} --unit 20 --out a")
    assert "10 m away" in reported.err
    assert "with --unit 1 it would be 0.50 m away" in reported.err
    assert "1 damaged frames are left out, the first: frames/2.png" in reported.out + reported.err


def test_a_failure_keeps_what_was_done(frames: Path) -> None:
    cv2.imwrite("frames/11.png", np.zeros((5, 6), np.uint16))
    for i in range(4, 11):
        Path(f"frames/{i}.png").write_bytes(Path("frames/3.png").read_bytes())
    error = run_tool(f"record frames {CAMERA} --out a.npz", status=1).err
    assert (
        "frames/11.png: 6 x 5 pixels; the camera has 64 x 48; a.npz has the 11 frames before it"
        in error
    )
    assert open_recording("a.npz").count == 11


def test_ctrl_c_keeps_what_was_done(frames: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checks = iter([0, 0, 2])
    monkeypatch.setattr(record.Stopper, "signum", property(lambda self: next(checks, 2)))
    error = run_tool(f"record frames {CAMERA} --out a", status=130).err
    assert "stopped; a has 2 frames" in error
    assert open_recording("a").count == 2


@mistakes_of("record")
def test_invalid_sources_and_outputs_are_rejected(frames: Path, argv: str, message: str) -> None:
    """Errors are one line, and nothing is written."""
    Path("loop").symlink_to("loop")
    assert refusal(f"record {argv}").startswith(message)
