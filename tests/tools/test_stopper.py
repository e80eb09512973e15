"""tools/stopper.py"""

from __future__ import annotations

import signal

import pytest

from tools.stopper import StoppedError, Stopper


def test_the_first_signal_is_noted_the_second_hits() -> None:
    """Between the two, ``check`` ends the run where it is safe; after it signals are what they were."""
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
