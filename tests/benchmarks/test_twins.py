"""benchmarks/twins.py: its command line."""

from __future__ import annotations

import pytest

twins = pytest.importorskip("benchmarks.twins")  # without fast/ there is nothing to time


@pytest.mark.parametrize(
    "options", [["--rounds", "0"], ["--threads", "-1"], ["--only", "slices", "nothing_such"]], ids=" ".join
)
def test_usage(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Wrong usage is argparse's own message, which names the option, and status 2."""
    with pytest.raises(SystemExit, match="2"):
        twins.main(options)
    assert options[0] in capsys.readouterr().err.splitlines()[-1]
