"""tools/common/progress.py: a progress bar is shown on a terminal only; signals stop a run
at a safe place.
"""

from __future__ import annotations

import io
import signal
import sys
from contextlib import redirect_stderr

import pytest

from tools.common.progress import ProgressBar, StoppedError, Stopper


class Terminal(io.StringIO):
    """A stderr that is a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_bar_on_a_terminal() -> None:
    """The bar shows progress and notes, allows lines to be printed above it, and is
    closed at the end.
    """
    pytest.importorskip("tqdm")
    with (
        redirect_stderr(Terminal()) as terminal,
        ProgressBar(10, what="fitting", done=2) as progress,
    ):
        progress(3)
        progress.reach(9)
        progress.note("loss 0.5")
        progress(1)
        progress.print("a line", terminal)
    shown = terminal.getvalue()
    assert "fitting: " in shown
    assert "10/10" in shown
    assert " frames/s" in shown
    assert "\ra line\n" in shown
    assert shown.endswith("\n")


def test_a_bar_is_closed_by_an_error() -> None:
    pytest.importorskip("tqdm")
    with (
        pytest.raises(KeyError),
        redirect_stderr(Terminal()) as terminal,
        ProgressBar(10) as progress,
    ):
        progress(1)
        raise KeyError
    assert terminal.getvalue().endswith("\n")


@pytest.mark.parametrize("total", [0, 10])
def test_no_bar(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], total: int
) -> None:
    """Without work, a terminal or tqdm no bar is shown, and the other methods can
    still be called.
    """
    if total:
        monkeypatch.setitem(sys.modules, "tqdm", None)
    for stream in (Terminal(), io.StringIO(), None):
        monkeypatch.setattr(sys, "stderr", stream)
        with ProgressBar(total) as progress:
            progress(1)
            progress.reach(2)
            progress.note("a note")
        assert stream is None or stream.getvalue() == ""
    assert capsys.readouterr().out == ""


def test_the_first_signal_is_recorded_and_the_second_interrupts() -> None:
    """The first one is recorded for ``check``; handlers are restored at the end."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with Stopper() as stopper:
            stopper.check()
            signal.raise_signal(signal.SIGINT)
            assert stopper.signum == signal.SIGINT
            with pytest.raises(StoppedError):
                stopper.check()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no SIGHUP on Windows")
def test_a_closed_terminal_stops_and_nohup_does_not() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        with Stopper() as stopper:
            signal.raise_signal(signal.SIGHUP)
            assert stopper.signum == signal.SIGHUP
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with Stopper() as stopper:
            signal.raise_signal(signal.SIGHUP)
            stopper.check()
    finally:
        signal.signal(signal.SIGHUP, before)
