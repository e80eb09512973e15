"""benchmarks/bench.py: its command line."""

from __future__ import annotations

import pytest

bench = pytest.importorskip("benchmarks.bench")  # without PyTorch there is nothing to time


@pytest.mark.parametrize("options", [["--rounds", "0"], ["--threads", "-1"]], ids=" ".join)
def test_usage(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Wrong usage is argparse's own message, which names the option, and status 2."""
    with pytest.raises(SystemExit, match="2"):
        bench.main(options)
    assert options[0] in capsys.readouterr().err.splitlines()[-1]
