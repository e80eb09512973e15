"""Scripts with the habits of public pycaffe scripts (scripts/) run unmodified, on small nets.

Each asserts its own results. All of them run in one process.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.running import run_python

SCRIPTS = Path(__file__).parent / "scripts"
NAMES = sorted(path.stem for path in SCRIPTS.glob("*.py") if path.stem not in ("all", "nets"))


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What ``python -m netlib.caffe`` prints for all scripts."""
    root = str(Path(__file__).resolve().parents[3])
    folder = tmp_path_factory.mktemp("scripts")
    return run_python("-m", "netlib.caffe", SCRIPTS / "all.py", *NAMES, cwd=folder, PYTHONPATH=root).out


@pytest.mark.parametrize("name", NAMES)
def test_script(printed: str, name: str) -> None:
    assert f"done: {name}\n" in printed, printed
