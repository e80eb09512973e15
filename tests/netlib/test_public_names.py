"""netlib/__init__.py: the public names, which are imported when they are first used."""

from __future__ import annotations

import pytest

import netlib
from tests.support.running import run_python

LARGE = "('numpy', 'scipy', 'cv2', 'h5py')"


def test_a_command_can_prepare_its_process_first() -> None:
    """``import netlib`` alone imports no large package."""
    code = f"import netlib, sys; print([name for name in {LARGE} if name in sys.modules])"
    assert run_python("-c", code).out == "[]\n"


def test_every_public_name_exists() -> None:
    code = "from netlib import *; import netlib; print({*netlib.__all__} <= {*globals()})"
    assert run_python("-c", code).out == "True\n"
    assert {*netlib.__all__} <= {*dir(netlib)}


def test_a_module_of_the_package_is_imported_by_its_name() -> None:
    code = "import netlib; print(netlib.engine.__name__, netlib.caffe.io.__name__)"
    assert run_python("-c", code).out == "netlib.engine netlib.caffe.io\n"


@pytest.mark.parametrize("name", ["Nets", "_private"])
def test_an_unknown_name(name: str) -> None:
    with pytest.raises(AttributeError, match=f"module 'netlib' has no attribute '{name}'"):
        getattr(netlib, name)
