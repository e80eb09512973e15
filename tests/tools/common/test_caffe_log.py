"""tools/common/caffe_log.py: log files."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from tools.common.caffe_log import log_to


def test_a_line_that_was_not_written_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a full disk the log ends with its last whole line, and one message reports the error."""
    with log_to(tmp_path / "a.log") as console:
        assert console.file is not None
        console.file.begin(())
        log = logging.getLogger("netlib")
        log.info("whole")
        whole = (tmp_path / "a.log").read_bytes()
        stream = console.file.stream

        def cut(text: str) -> int:
            stream.buffer.write(text.encode()[:9])
            stream.buffer.flush()
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(stream, "write", cut)
        log.info("cut")
        log.info("on stderr only")
    assert (tmp_path / "a.log").read_bytes() == whole and whole.endswith(b"whole\n")
    assert capsys.readouterr().err.count("cannot continue the log: No space left on device") == 1
