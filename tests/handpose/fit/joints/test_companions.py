"""handpose/fit/joints/companions.py: files with the angles of a data file."""

import os
from dataclasses import replace

import h5py
import numpy as np
import pytest

from handpose.fit.joints import companions
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs

NYU_HAND = skeleton.load()  # the labels that are fitted are of NYU's joints
PACKAGED_BONES = prior_file.load().but(scale_std=0, bone_std=0)
FRAMES = 6
SEEN_MM = 130.5  # half a cube


@pytest.fixture
def source(tmp_path):
    """data/part.h5 with frames of hands; the first hand is partly outside its cube, where
    joints are clipped.
    """
    inputs = BodySampler(PACKAGED_BONES).draw(np.random.default_rng(3), FRAMES).inputs
    inputs[0, NYU_HAND.dof_names.index("palm_y")] += 0.6
    joints = np.clip(kinematics_of(NYU_HAND).joints(inputs), -1, 1)
    write(tmp_path / "data" / "part.h5", joint=joints.reshape(FRAMES, 93))
    return tmp_path / "data" / "part.h5"


def write(path, **arrays):
    """A file with these arrays, depth and half-cubes."""
    rows = len(next(iter(arrays.values())))
    depth = np.random.default_rng(0).uniform(-1, 1, (rows, 1, 4, 4)).astype(np.float32)
    path.parent.mkdir(exist_ok=True)
    with h5py.File(path, "w") as file:
        for name, array in {"depth": depth, "half_cube": np.full(rows, SEEN_MM), **arrays}.items():
            file[name] = array
        file.attrs["made_from"] = "a test"


def fitted(source, hand=NYU_HAND, **options):
    """The path of the companion angles/part.h5, and the residuals."""
    target = source.parent.parent / "angles" / "part.h5"
    companions.fit_file(source, target, hand, **options)
    with h5py.File(target) as file:
        return target, file["residual_mm"][...]


def net_on(files, net_of, *tops):
    """A net that reads the files with all rows in one batch."""
    source = files[0].parent.parent / "list.txt"
    source.write_text("".join(f"{path}\n" for path in files))
    names = " ".join(f'top: "{top}"' for top in tops)
    return net_of(
        f'layer {{ name: "d" type: "HDF5Data" {names} '
        f'hdf5_data_param {{ source: "{source}" batch_size: {FRAMES * len(files)} }} }}'
    )


def test_the_angles_put_the_joints_where_they_are(source):
    """``dof`` is input for the layer HandModel; ``residual_mm`` is the remaining distance in mm.

    A joint clipped at the cube has residual NaN, and the other joints determine the hand.
    """
    target, residuals = fitted(source)
    with h5py.File(source) as file:
        truth = file["joint"][...].reshape(FRAMES, 31, 3)
    with h5py.File(target) as file:
        dof = file["dof"][...]
    assert (dof.dtype, dof.shape, residuals.shape) == (np.float32, (FRAMES, 47), (FRAMES, 31))
    cut, joints = (np.abs(truth) >= 1).any(axis=2), kinematics_of(NYU_HAND).joints(dof)
    assert 0 < cut[0].sum() < 20 and not cut[1:].any()
    assert np.array_equal(np.isnan(residuals), cut)
    assert np.abs((joints - truth)[~cut]).max() < 1e-5
    distances = np.linalg.norm(joints - truth, axis=2) * SEEN_MM
    assert residuals[~cut] == pytest.approx(distances[~cut], abs=1e-3)
    assert np.abs(joints[:1]).max() > 1, "where the joint would be, outside the cube"


def test_options_reach_the_fit(source):
    """A large ridge keeps the hand near its initial pose, which increases the residual."""
    _, free = fitted(source)
    _, pulled = fitted(source, ridge=10.0)
    assert np.nanmean(pulled) > 10 > np.nanmean(free)


def test_a_list_of_companions_reads_like_the_list_of_the_data(source, tmp_path, net_of):
    """The companion gives the same depth and joints, and its own angles, also where both
    folders were moved.
    """
    with h5py.File(source, "a") as file:
        file["dof"] = np.full((FRAMES, 47), 9.0)  # as in synthetic data
    first = net_on([source], net_of, "depth", "joint").forward()
    fitted(source)
    (tmp_path / "elsewhere").mkdir()
    for folder in ("data", "angles"):
        (tmp_path / folder).rename(tmp_path / "elsewhere" / folder)
    target = tmp_path / "elsewhere" / "angles" / "part.h5"
    second = net_on([target], net_of, "depth", "joint", "dof").forward()
    for name in ("depth", "joint"):
        assert np.array_equal(first[name], second[name])
    with h5py.File(target) as file:
        assert np.array_equal(second["dof"], file["dof"]) and (np.abs(file["dof"][...]) < 9).all()
        assert file.attrs["made_from"] == "a test"
        assert (sorted(file), file.attrs["rest_in"]) == (["dof", "residual_mm"], "../data/part.h5")


LONGER = [
    replace(j, bone=j.bone and replace(j.bone, length=1.1 * j.bone.length))
    for j in NYU_HAND.param.joint
]


@pytest.mark.parametrize(
    "change",
    [
        lambda source, target: {},
        lambda source, target: os.utime(source, ns=(1, 1)) or {},
        lambda source, target: {"limits": False},
        lambda source, target: {"ridge": 1e-3},
        lambda source, target: {
            "hand": skeleton.Skeleton(replace(NYU_HAND.param, joint=tuple(LONGER)))
        },
        lambda source, target: target.write_bytes(target.read_bytes()[:200]) and {},
    ],
    ids=[
        "nothing",
        "the file",
        "limits",
        "ridge",
        "another hand of this name",
        "a broken companion",
    ],
)
def test_a_companion_is_made_again_only_after_a_change(source, change, request):
    """A companion made in the same way from the same file is reused; all frames
    count as progress.
    """
    target, _ = fitted(source)
    options = change(source, target)
    reported = []
    os.utime(target, ns=(1, 1))
    fitted(source, progress=reported.append, **options)
    assert (target.stat().st_mtime_ns == 1) == (request.node.callspec.id == "nothing")
    assert sum(reported) == FRAMES


@bad_inputs(
    DataError,
    {
        "the data": (
            ("more.h5", "data"),
            "...part.h5: would replace the data themselves; choose another --out",
        ),
        "the data, by another name": (
            ("more.h5", "out/../data"),
            "...part.h5: would replace the data themselves; choose another --out",
        ),
        "one name twice": (
            ("../other/part.h5", "out"),
            "...out: two files of the list have the same name, expected different ones",
        ),
        "far away": (
            ("more.h5", "far/away"),
            "...part.h5: is not next to the folder of the data, ...part.h5; expected "
            "--out ...data_angles, for example",
        ),
    },
)
def test_companions_replace_nothing(source, tmp_path, given, rejected):
    """Neither data nor other companions are overwritten, and the folders are next to each other."""
    with rejected:
        companions.companions_of([source, source.parent / given[0]], tmp_path / given[1])


@bad_inputs(
    DataError,
    {
        "no joints": (
            {"other": np.zeros(2)},
            "...bad.h5: no data set 'joint'; it has depth, half_cube, other",
        ),
        "14 joints": (
            {"joint": np.zeros((2, 42))},
            "...bad.h5: data set 'joint' has shape (2, 42), expected (N, 93) for 31 joints",
        ),
        "all cut off": (
            {"joint": np.ones((2, 93))},
            "...bad.h5: frame 0 has no known joint (2 such frames)",
        ),
    },
)
def test_invalid_files_are_rejected(tmp_path, given, rejected):
    """The error names the file on one line, and no file is written."""
    write(tmp_path / "data" / "bad.h5", **given)
    with rejected:
        fitted(tmp_path / "data" / "bad.h5")
    assert not (tmp_path / "angles").exists()
