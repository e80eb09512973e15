"""docs/live.md and docs/making/live_picture.py"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from docs.making import live_picture
from docs.making.live_picture import PICTURE, SIZE
from handpose.live.messages import Messages
from handpose.live.server import LINES, LiveServer
from handpose.track_files.track import TrackedFrame
from netlib.errors import NetlibError
from netlib.files.paths import ROOT
from tests.support.tracked_hands import HEADER, tracked

LARGEST = 200_000  # bytes


def test_the_example_for_programs(tmp_path: Path) -> None:
    """Prints where the tip of the index finger is, of each hand in each frame, and ends with the recording."""
    pytest.importorskip("websockets")
    text = (ROOT / "docs" / "live.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"<!-- file: watch.py -->\n```python\n(.*?)```", text, re.DOTALL)
    assert len(program.splitlines()) <= 10
    (tmp_path / "watch.py").write_text(program, encoding="utf-8")
    messages = Messages(HEADER)
    hands = [tracked("right", (-75, 0, 600), 1), tracked("left", (75, 0, 640), 2)]
    with LiveServer("127.0.0.1", 0, messages.header, "") as server:
        command = [sys.executable, str(tmp_path / "watch.py"), server.lines_url]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert server.wait_for_client(60)
        server.put(LINES, messages.line(messages.record(TrackedFrame(0, 0.0, tuple(hands)))))
    out, _ = process.communicate(timeout=60)
    tip = HEADER.skeleton.joint_names.index("index_tip")
    expected = [f"{hand.hand} {[float(mm) for mm in hand.xyz[tip].round(2)]}" for hand in hands]
    assert process.returncode == 0 and out.splitlines() == expected


def test_the_picture_of_the_document() -> None:
    """It is there, small, of the size that is said, and shows something."""
    raw = PICTURE.read_bytes()
    image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR)
    assert len(raw) < LARGEST and image.shape == (SIZE["height"], SIZE["width"], 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 1000


def test_without_a_browser(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """One line says what is missing, and the picture stays."""

    def none() -> object:
        raise NetlibError("no Chromium: install it")

    monkeypatch.setattr(live_picture, "chromium", none)
    before = PICTURE.read_bytes()
    assert live_picture.main() == 1 and capsys.readouterr().err == "no Chromium: install it\n"
    assert PICTURE.read_bytes() == before
