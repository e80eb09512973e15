"""handpose/datasets/labels.py: joints and half-cubes of an HDF5 file."""

import h5py
import numpy as np
import pytest

from handpose.datasets import labels
from handpose.frames.cameras import CAMERAS, NYU, Camera
from netlib.errors import DataError
from netlib.files.hdf5 import File
from tests.support.bad_input import bad_inputs
from tests.support.hdf5_files import write_hdf5

ROWS = np.linspace(-1, 1, 4 * 6).reshape(4, 6)  # four frames of two joints


def at(values, number, where=1):
    """A copy of the values with another number in one frame."""
    changed = np.array(values, np.float64)
    changed[where] = number
    return changed


@pytest.mark.parametrize("shape", [(4, 6), (4, 2, 3)])
@pytest.mark.parametrize("dtype", ["f4", "i2"])
def test_joints(here, shape, dtype):
    stored = (100 * ROWS).astype(dtype)
    joints = labels.read(write_hdf5("a.h5", joint=stored.reshape(shape)), 2).joints
    assert joints.dtype == np.float64 and np.array_equal(joints, stored.reshape(4, 2, 3))


@pytest.mark.parametrize("shape", [(4,), (4, 1)])
def test_half_cubes(here, shape):
    """There is one half-cube per frame, from the labels and from an open file alike."""
    path = write_hdf5("a.h5", joint=ROWS, half_cube=np.arange(100, 104, dtype="i2").reshape(shape))
    for found in (labels.read(path, 2).half_cube, labels.read_half_cubes(File(path, ("joint",)))):
        assert found.dtype == np.float64 and found.tolist() == [100, 101, 102, 103]


def test_half_cubes_and_the_origin_are_optional(here):
    """Without half-cubes NYU's are taken; the origin is unknown unless the file names it."""
    path = write_hdf5("a.h5", joint=ROWS)
    found = labels.read(path, 2)
    assert found.half_cube.tolist() == [150] * 4 and found.made_from == "an unknown source"
    with h5py.File(path, "a") as file:
        file.attrs["made_from"] = "a test"
    assert labels.read(path, 2).made_from == "a test"


def test_missing_joints_and_those_outside_the_crop_are_unseen(here):
    joints = np.array(
        [
            [0.5, -0.5, 0, 0.9, -0.9, 0],
            [0, 0, 1, 0, -1, 0],
            [0, 0, 0, np.nan, 0, 0],
            [0, 2, 0, 0, 0, 0],
        ]
    )
    found = labels.read(write_hdf5("a.h5", joint=joints), 2)
    assert np.array_equal(found.joints.reshape(4, 6), joints, equal_nan=True)
    assert found.seen.tolist() == [[True, True], [False, False], [True, False], [False, True]]


# ----------------------------------------------------------------------------------------- mistakes


JOINTS = "(N, 6) for 2 joints"


@bad_inputs(
    DataError,
    {
        line: (arrays, f"...a.h5: {line}")
        for arrays, line in (
            ({"other": np.zeros(2)}, "no data set 'joint'; it has other"),
            ({"joint": np.array([b"a", b"b"])}, "data set '/joint' holds |S1, expected numbers"),
            *(
                (
                    {"joint": np.zeros(shape)},
                    f"data set 'joint' has shape {shape}, expected {JOINTS}",
                )
                for shape in ((6,), (4, 7), (4, 12), (4, 3, 2))
            ),
            (
                {"joint": at(ROWS, -np.inf, [2, 3])},
                "data set 'joint' is infinite in frame 2 (2 such frames), expected ...",
            ),
            (
                {"half_cube": np.array([b"150"] * 4)},
                "data set '/half_cube' holds |S3, expected numbers",
            ),
            *(
                (
                    {"half_cube": np.ones(shape)},
                    f"data set 'half_cube' has shape {shape}, expected (4,): mm, one ...",
                )
                for shape in ((3,), (4, 3))
            ),
            *(
                (
                    {"half_cube": at(np.full(4, 150.0), value)},
                    f"data set 'half_cube' is {value:g} in frame 1 (1 such frames), expected mm, 25 to ...",
                )
                for value in (0, np.nan, np.inf)
            ),
            *(
                (
                    {"half_cube": np.full(4, value)},
                    f"data set 'half_cube' is {value} in frame 0 (4 such frames), ...",
                )
                for value in (0.15, -1)
            ),
        )
    },
)
def test_invalid_labels_are_rejected(here, given, rejected):
    """The error names the file, the data set, what was found and what was expected, on one line."""
    path = write_hdf5("a.h5", **({"joint": ROWS} if "half_cube" in given else {}), **given)
    with rejected:
        labels.read(path, 2)


def centers_in(path, uvd, xyz):
    """The crop centres of a file that has these."""
    return labels.read_crop_centers(
        [File(write_hdf5(path, joint=ROWS, center_uvd=uvd, center=xyz), ("joint",))]
    )


@pytest.mark.parametrize("name", CAMERAS)
def test_the_camera_of_one_frame(here, name):
    """A known camera is recognised from the centre of one frame."""
    uvd = np.tile([200.0, 100.0, 700.0], (4, 1))
    found, camera = centers_in("a.h5", uvd, CAMERAS[name].unproject(uvd))
    assert camera == CAMERAS[name] and np.allclose(found, uvd)


@pytest.mark.parametrize(
    ("camera", "by"), [(NYU, 0.0), (Camera("mine", 500.0, 510.0, 333.0, 222.0, 666, 444), 50.0)]
)
def test_crop_centers_that_fit_no_known_camera_are_rejected(here, camera, by):
    """On the optical axis all cameras agree; an unknown camera, and several, are refused."""
    uvd = np.tile([camera.u0 + by, camera.v0 + by, 700.0], (4, 1))
    with pytest.raises(
        DataError, match=r"a\.h5: its crop centres in px and in mm fit none of the cameras nyu, "
    ):
        centers_in("a.h5", uvd, camera.unproject(uvd))


@pytest.mark.parametrize("value", [1e-300, 1e300, np.nan, np.inf, -700.0, 0.0])
def test_invalid_crop_centers_are_rejected(here, value):
    """Centres that are not finite, or not in front of the camera, raise an error of one line."""
    uvd = np.array([[200.0, 100, 700], [400, 90, 600], [300, 300, 500], [500, 200, 800]])
    with pytest.raises(
        DataError, match=r"a\.h5: crop centres that are not finite, or not before the camera"
    ):
        centers_in("a.h5", uvd, at(NYU.unproject(uvd), value, (2, 2)))


def test_crop_centers_of_other_frames_are_rejected(here):
    with pytest.raises(
        DataError, match=r"a\.h5: data set 'center_uvd' has shape \(4, 2\), expected \(4, 3\)"
    ):
        centers_in("a.h5", np.ones((4, 2)), np.ones((4, 3)))
