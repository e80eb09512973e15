"""handpose/output/live/pace.py"""

from __future__ import annotations

import threading

from handpose.output.live.pace import PAUSE, PLAY, STEP, Pace


def test_frames_pass_unless_a_client_holds_them() -> None:
    """Every client that paused must play again; a step lets one frame pass, and is ignored while playing."""
    pace = Pace()
    pace.command("one", STEP)
    assert pace.wait(0) and pace.wait(0)
    pace.command("one", PAUSE)
    pace.command("other", PAUSE)
    assert not pace.wait(0)
    pace.command("one", STEP)
    pace.command("one", STEP)
    assert [pace.wait(0) for _ in range(3)] == [True, True, False]
    pace.command("one", PLAY)
    assert not pace.wait(0)
    pace.command("other", PLAY)
    assert pace.wait(0) and pace.wait(0)


def test_a_waiting_tracker_is_woken() -> None:
    """A wait in another thread ends with the command."""
    pace, passed = Pace(), threading.Event()
    pace.command("one", PAUSE)

    def track() -> None:
        if pace.wait(60):
            passed.set()

    thread = threading.Thread(target=track)
    thread.start()
    pace.command("one", STEP)
    thread.join()
    assert passed.is_set()
