"""tools/common/progress.py: a progress bar is shown on a terminal only."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stderr

import pytest

from tools.common.progress import ProgressBar


class Terminal(io.StringIO):
    """A stderr that is a terminal."""

    def isatty(self) -> bool:
        """Return True."""
        return True


def test_a_bar_on_a_terminal() -> None:
    """The bar shows progress and notes, allows lines to be printed above it, and is closed at the end."""
    pytest.importorskip("tqdm")
    with redirect_stderr(Terminal()) as terminal, ProgressBar(10, what="fitting", done=2) as progress:
        assert progress.is_shown
        progress(3)
        progress.reach(9)
        progress.note("loss 0.5")
        progress(1)
        progress.print("a line", terminal)
    assert not progress.is_shown
    shown = terminal.getvalue()
    assert "fitting: " in shown and "10/10" in shown and " frames/s" in shown and "\ra line\n" in shown
    assert shown.endswith("\n")


def test_a_bar_is_closed_by_an_error() -> None:
    """An error closes the bar, so that its message starts on a new line."""
    pytest.importorskip("tqdm")
    with pytest.raises(KeyError), redirect_stderr(Terminal()) as terminal, ProgressBar(10) as progress:
        progress(1)
        raise KeyError
    assert terminal.getvalue().endswith("\n")


@pytest.mark.parametrize("total", [0, 10])
def test_no_bar(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], total: int) -> None:
    """Without work, a terminal or tqdm no bar is shown, and all methods can still be called."""
    if total:
        monkeypatch.setitem(sys.modules, "tqdm", None)
    for stream in (Terminal(), io.StringIO(), None):
        monkeypatch.setattr(sys, "stderr", stream)
        with ProgressBar(total) as progress:
            assert not progress.is_shown
            progress(1)
            progress.reach(2)
            progress.note("a note")
            progress.print("a line", sys.stdout)
        assert stream is None or stream.getvalue() == ""
    assert capsys.readouterr().out == "a line\n" * 3
