"""docs/live.md: its example program."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from handpose.output.live.messages import Messages
from handpose.output.live.server import LINES, LiveServer
from handpose.tracking.track import TrackedFrame
from netlib.files.paths import ROOT
from tests.support.tracked_hands import HEADER, tracked


def test_the_example_for_programs(tmp_path: Path) -> None:
    """The example prints the position of each hand's index fingertip in each frame, and ends with the recording."""
    pytest.importorskip("websockets")
    text = (ROOT / "docs" / "live.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"<!-- file: watch.py -->\n```python\n(.*?)```", text, re.DOTALL)
    assert len(program.splitlines()) <= 10
    (tmp_path / "watch.py").write_text(program, encoding="utf-8")
    messages = Messages(HEADER)
    hands = [tracked("right", (-75, 0, 600), 1), tracked("left", (75, 0, 640), 2)]
    with LiveServer("127.0.0.1", 0, messages.header, "") as server:
        (tmp_path / "live.json").write_text(json.dumps({"frames": server.lines_url}), encoding="utf-8")
        command = [sys.executable, str(tmp_path / "watch.py")]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path)
        assert server.wait_for_client(60)
        server.put(LINES, messages.line(messages.record(TrackedFrame(0, 0.0, tuple(hands)))))
    out, _ = process.communicate(timeout=60)
    tip = HEADER.skeleton.joint_names.index("index_tip")
    expected = [f"{hand.hand} {[float(mm) for mm in hand.xyz[tip].round(2)]}" for hand in hands]
    assert process.returncode == 0 and out.splitlines() == expected
