"""handpose/moved.py: old names of modules."""

from __future__ import annotations

import importlib

import pytest


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("handpose.predicting.packaged", "handpose.prediction.packaged"),
        ("handpose.fitting.levenberg_marquardt", "handpose.joint_fit.levenberg_marquardt"),
        ("handpose.fitting.depth.search", "handpose.depth_fit.search"),
        ("handpose.recordings.opening", "handpose.sources.opening"),
        ("handpose.tracks.json_file", "handpose.track_files.json_file"),
    ],
)
def test_an_old_name_is_the_same_module(old: str, new: str) -> None:
    """Importing an old name gives the same module, with a warning that names the new one."""
    with pytest.warns(DeprecationWarning) as caught:
        module = importlib.import_module(old)
    assert str(caught[-1].message) == f"{old} is now {new}; the old name goes with the next release"
    assert module is importlib.import_module(new)
    assert module.__name__ == new


def test_what_never_was() -> None:
    """A module that never existed raises ModuleNotFoundError under an old package too."""
    with pytest.warns(DeprecationWarning), pytest.raises(ModuleNotFoundError, match=r"handpose\.prediction\.none"):
        importlib.import_module("handpose.predicting.none")
