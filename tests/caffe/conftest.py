"""Fixtures of the comparisons with Caffe.

The fixture ``caffe_data``, the folder itself, is in tests/conftest.py.
"""

from pathlib import Path

import pytest


@pytest.fixture
def solvers(caffe_data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the recorded training runs as the working directory, to which paths in their
    files are relative.
    """
    monkeypatch.chdir(caffe_data / "solvers")
    return caffe_data / "solvers"


@pytest.fixture
def whole(caffe_data: Path) -> Path:
    """The whole recordings; skips the test if they are not available."""
    folder = caffe_data.parents[2] / "shared/data/caffe"
    if not folder.is_dir():
        pytest.skip("needs the whole recordings, 33 MB, which a clone does not have")
    return folder
