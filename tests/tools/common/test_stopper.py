"""tools/common/stopper.py"""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tools.common.stopper import StoppedError, Stopper, fill_folder


def test_the_first_signal_is_noted_the_second_hits() -> None:
    """The first signal is recorded for ``check``, the second interrupts at once; handlers are restored at the end."""
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


def test_a_folder_is_filled(tmp_path: Path) -> None:
    """The folder is created first."""
    assert fill_folder(tmp_path / "a" / "b", "all is", 1, lambda advance: (tmp_path / "a" / "b" / "file").touch()) == 0
    assert (tmp_path / "a" / "b" / "file").exists()


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_filling(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], number: signal.Signals, status: int
) -> None:
    """A signal ends the work at the next part, with one line and the status of the signal."""
    filled = []

    def fill(advance: Callable[[int], None]) -> None:
        for part in range(3):
            signal.raise_signal(number)
            filled.append(part)
            advance(1)

    assert fill_folder(tmp_path, "whole files are", 3, fill) == status
    assert filled == [0]
    assert capsys.readouterr() == ("", "stopped; whole files are kept, and the next run continues after them\n")
