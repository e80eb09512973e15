"""Pausing a recording: pages hold it and let single frames pass, and the tracker waits before each frame."""

from __future__ import annotations

import threading

PAUSE, PLAY, STEP = COMMANDS = ("pause", "play", "step")


class Pace:
    """Who holds the recording, and how many frames may pass; safe for several threads."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._holders: set[object] = set()
        self._steps = 0

    def command(self, client: object, word: str) -> None:
        """Follow a client's command, one of COMMANDS; the recording plays when no client holds it."""
        with self._changed:
            if word == PAUSE:
                self._holders.add(client)
            elif word == PLAY:
                self._holders.discard(client)
            elif word == STEP and self._holders:
                self._steps += 1
            if not self._holders:
                self._steps = 0
            self._changed.notify_all()

    def wait(self, seconds: float) -> bool:
        """Wait at most this long until a frame may pass; True if it may, which uses up a step."""
        with self._changed:
            free = self._changed.wait_for(lambda: not self._holders or self._steps > 0, seconds)
            if self._steps:
                self._steps -= 1
            return free
