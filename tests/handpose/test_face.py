"""handpose: its public names are imported when they are used, and nothing else is."""

import pytest

import handpose
from tests.support.running import run_python

NAMES = sorted(handpose._MODULE_OF)


@pytest.mark.parametrize("name", NAMES)
def test_every_name_exists(name):
    """A public name is the object of that name in its module, and is listed."""
    assert getattr(handpose, name) is not None
    assert name in dir(handpose)


def test_other_names_do_not_exist():
    """A misspelled name is an AttributeError, as of any module, and so an ImportError of
    a from-import.
    """
    with pytest.raises(
        AttributeError, match=r"^module 'handpose' has no attribute 'load_predictors'$"
    ):
        handpose.load_predictors  # noqa: B018
    with pytest.raises(ImportError):
        from handpose import open_recordings  # noqa: F401


def test_a_camera_needs_numpy_only():
    """The cameras' parameters load neither the layer graph nor OpenCV, SciPy or h5py."""
    code = "import sys, handpose; handpose.NYU; print(*{'netlib', 'cv2', 'scipy', 'h5py'} & set(sys.modules))"
    assert run_python("-c", code).out.split() == []
