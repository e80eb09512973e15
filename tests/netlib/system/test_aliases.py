"""Modules that have moved can be imported by their old names, for one release."""

from __future__ import annotations

import importlib
import sys

import pytest

import netlib


@pytest.mark.parametrize(
    ("old", "new"),
    [("messages", "proto.messages"), ("mpi", "distributed.mpi"), ("saved", "snapshots.solver_state")],
)
def test_a_module_by_its_old_name(old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The old name imports the same module and warns with the new name."""
    name = f"netlib.{old}"
    assert name not in sys.modules
    monkeypatch.setattr(netlib, old, None, raising=False)
    try:
        with pytest.warns(DeprecationWarning, match=f"^{name} is now netlib.{new}; the old name will be removed"):
            assert importlib.import_module(name) is importlib.import_module(f"netlib.{new}")
    finally:
        sys.modules.pop(name, None)


def test_no_module_by_another_name() -> None:
    """Other names raise an ImportError."""
    with pytest.raises(ImportError, match=r"netlib\.never"):
        importlib.import_module("netlib.never")
